// Numbers as people read them.

const whole = new Intl.NumberFormat("en");

export function count(n: number, one: string, many = `${one}s`): string {
  return `${whole.format(n)} ${n === 1 ? one : many}`;
}

export function large(n: number): string {
  if (n < 10_000) return whole.format(n);
  return n < 1e6 ? `${(n / 1e3).toFixed(n < 1e5 ? 1 : 0)} k` : `${(n / 1e6).toFixed(n < 1e7 ? 2 : 1)} M`;
}

export function bytes(n: number): string {
  if (n < 1000) return `${n} B`;
  const unit = n < 1e6 ? 1e3 : n < 1e9 ? 1e6 : 1e9;
  const value = n / unit;
  return `${value < 10 ? value.toFixed(1) : value.toFixed(0)} ${{ 1e3: "kB", 1e6: "MB", 1e9: "GB" }[unit]}`;
}

export function metres(m: number): string {
  if (m < 1) return `${(100 * m).toFixed(m < 0.1 ? 1 : 0)} cm`;
  return m < 1000 ? `${m.toFixed(m < 10 ? 2 : 0)} m` : `${(m / 1000).toFixed(2)} km`;
}

export function percent(share: number): string {
  return `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`;
}

export function duration(seconds: number): string {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}
