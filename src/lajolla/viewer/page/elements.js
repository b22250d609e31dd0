// Small helpers for the page's elements, and numbers as text.

export const element = (id) => document.getElementById(id);

export function made(tag, text = "", attributes = {}) {
  const result = Object.assign(document.createElement(tag), attributes);
  if (text !== "") result.textContent = text;
  return result;
}

// Fills a <dl> with names and values; empty values are left out.
export function list(id, rows) {
  const shown = rows.filter(([, value]) => value !== null && value !== undefined && value !== "");
  element(id).replaceChildren(...shown.flatMap(([name, value]) => [made("dt", name), made("dd", value)]));
}

export const rounded = (number, digits = 4) => String(Number(number.toPrecision(digits)));

export function short(number, unit) {
  const [divisor, prefix] =
    number >= 1e9 ? [1e9, "G"] : number >= 1e6 ? [1e6, "M"] : number >= 1e3 ? [1e3, "k"] : [1, ""];
  return `${rounded(number / divisor, 3)} ${prefix}${unit}`;
}

export function duration(seconds) {
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  return whole < 3600
    ? `${Math.floor(whole / 60)} min ${whole % 60} s`
    : `${Math.floor(whole / 3600)} h ${Math.floor(whole / 60) % 60} min`;
}

export const percent = (share) => `${rounded(100 * share, 2)} %`;
