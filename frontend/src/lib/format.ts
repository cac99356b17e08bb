/** Numbers, sizes and times as people read them. */

export function fixed(value: number | null | undefined, digits = 2): string {
  return typeof value === "number" && Number.isFinite(value) ? value.toFixed(digits) : "–";
}

/** A number with as many digits as help at its size. */
export function compact(value: unknown): string {
  if (typeof value === "string" || typeof value === "boolean") return String(value);
  if (typeof value !== "number") return "–";
  if (!Number.isFinite(value)) return "–";
  if (Number.isInteger(value)) return value.toLocaleString("en");
  const size = Math.abs(value);
  return size >= 1000 ? value.toFixed(1) : size >= 1 ? value.toFixed(3) : value.toPrecision(4);
}

/** "1 vehicle", "300 vehicles". */
export function counted(count: number, thing: string): string {
  return `${compact(count)} ${thing}${count === 1 ? "" : "s"}`;
}

export function bytes(count: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count;
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${unit === 0 ? value : value.toFixed(value < 10 ? 1 : 0)} ${units[unit]}`;
}

export function seconds(value: number | null | undefined): string {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  if (value < 10) return `${value.toFixed(1)} s`;
  if (value < 120) return `${Math.round(value)} s`;
  return `${Math.floor(value / 60)} min ${Math.round(value % 60)} s`;
}

/** About how long something still takes. */
export function timeLeft(value: number): string {
  if (value < 90) return `about ${Math.max(5 * Math.round(value / 5), 5)} s left`;
  return value < 5400 ? `about ${Math.round(value / 60)} min left` : `about ${(value / 3600).toFixed(1)} h left`;
}

export function milliseconds(ns: number): string {
  return `${(ns / 1e6).toFixed(1)} ms`;
}

/** A moment in the reader's own time zone. */
export function moment(iso: string | null | undefined): string {
  if (!iso) return "–";
  return new Date(iso).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "short" });
}

/** "rejected_two_rings" as words. */
export function words(name: string): string {
  return name.replaceAll("_", " ");
}

export function percent(fraction: number): string {
  return `${Math.round(fraction * 100)} %`;
}

/** A fact, warning or alarm of any shape as one line. */
export function sentence(value: unknown): string {
  if (typeof value === "string" || typeof value === "boolean") return String(value);
  if (typeof value !== "object" || value === null) return compact(value);
  if (Array.isArray(value)) return value.map(sentence).join(", ");
  const parts = value as Record<string, unknown>;
  for (const key of ["detail", "message", "sentence", "title"]) {
    if (typeof parts[key] === "string") return parts[key];
  }
  return Object.entries(parts)
    .map(([name, part]) => `${words(name)}: ${sentence(part)}`)
    .join("; ");
}
