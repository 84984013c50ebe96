// Told apart in both themes, and by most people with a colour weakness: lightness differs too.
const PALETTE = ["#4c9be8", "#f2a541", "#54c7a0", "#e06c9f", "#a78bfa", "#d8d15a", "#5bc8d9", "#e0704f", "#8fbf4d", "#b8a38d"];

/** The colour of each session, by the order of their names. */
export class SessionColours {
  private readonly colours = new Map<string, string>();

  set(sessions: string[]): void {
    for (const name of sessions) {
      if (!this.colours.has(name)) this.colours.set(name, PALETTE[this.colours.size % PALETTE.length]!);
    }
  }

  readonly of = (session: string): string => this.colours.get(session) ?? PALETTE[0]!;
}
