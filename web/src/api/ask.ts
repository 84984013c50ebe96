/** What the server answered instead of what was asked for; status 0: it did not answer. */
export class ServerError extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    message: string,
  ) {
    super(message);
    this.name = "ServerError";
  }
}

/** An answer that holds what was asked for. Throws ServerError, AbortError. */
export async function ask(url: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(url, init);
  } catch (error) {
    if ((error as Error).name === "AbortError") throw error;
    throw new ServerError(0, "unavailable", "The server does not answer. Is cellmapd still running?");
  }
  if (response.ok) return response;
  const problem = await response.json().catch(() => ({}));
  throw new ServerError(response.status, problem.code ?? "internal", problem.detail ?? `The server answered ${response.status}.`);
}
