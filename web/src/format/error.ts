/** What is wrong with bytes from outside; the words are those of the server's problem documents. */
export type FormatErrorCode = "corrupt-data" | "unsupported" | "too-large";

/** Thrown by every reader of this folder, and nothing else is: the message says what was expected and found. */
export class FormatError extends Error {
  constructor(
    readonly code: FormatErrorCode,
    message: string,
  ) {
    super(message);
    this.name = "FormatError";
  }
}

export function corrupt(message: string): never {
  throw new FormatError("corrupt-data", message);
}

export function unsupported(message: string): never {
  throw new FormatError("unsupported", message);
}

export function tooLarge(message: string): never {
  throw new FormatError("too-large", message);
}
