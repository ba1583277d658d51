// Numbers, durations and times as a person reads them.

import { el } from "./dom.js";

const NOTHING = "–";
const THIN = "\u202f";
const PREFIXES = [
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
];
const CLOSE = new Set(["°", "′", "″"]);
const UNITS = [
  [/\b(degC|celsius)\b/g, "°C"],
  [/\b(degree|deg)\b/g, "°"],
  [/\barcsec\b/g, "″"],
  [/\bsqrt\((\w+)\)/g, "√$1"],
  [/\^1\b/g, ""],
  [/\^(-?\d+)/g, (_, power) => raised(power)],
];
const SUPERSCRIPT = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

/** To so many significant digits, without needless zeros; powers of ten where it is very large or small. */
export function number(value, digits = 5) {
  if (!known(value)) return NOTHING;
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e7 || size < 1e-4)) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return `${signed(String(Number(mantissa)))} × 10${raised(power.replace("+", ""))}`;
  }
  return signed(String(Number(value.toPrecision(digits))));
}

/** With so many decimals, for a value that is watched: its width does not change with its last digit. */
export function fixed(value, decimals) {
  return known(value) ? signed(value.toFixed(decimals)) : NOTHING;
}

/** A value and its unit, or a dash. */
export function measure(value, unit, digits = 5) {
  return known(value) ? joined(number(value, digits), unit) : NOTHING;
}

/** A small voltage with a prefix: 612 µV. */
export function small(value, unit) {
  if (!known(value)) return NOTHING;
  const size = Math.abs(value);
  const [factor, prefix] = PREFIXES.find(([least]) => size >= least) ?? PREFIXES[size === 0 ? 0 : 3];
  return `${signed(String(Number((value / factor).toPrecision(3))))}${THIN}${prefix}${unit}`;
}

/** A whole number in groups of three. */
export function count(value) {
  return known(value) ? Math.round(value).toLocaleString("en").replaceAll(",", THIN) : NOTHING;
}

/** A share, 0 to 1, in percent, to so many significant digits. */
export function percent(share, digits = 3) {
  if (!known(share)) return NOTHING;
  const places = share ? Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(100 * share)) + 1e-9)) : 0;
  return `${signed((100 * share).toFixed(Math.min(places, 12)))}${THIN}%`;
}

/** Seconds as the two largest units that it takes: 12 h 3 min. */
export function duration(seconds) {
  if (!known(seconds)) return NOTHING;
  const whole = Math.round(Math.abs(seconds));
  const sign = seconds <= -0.5 ? "−" : "";
  if (whole < 60)
    return `${sign}${Math.abs(seconds) < 9.95 ? Number(Math.abs(seconds).toPrecision(2)) : whole}${THIN}s`;
  const parts = [
    [86400, "d"],
    [3600, "h"],
    [60, "min"],
    [1, "s"],
  ];
  const first = parts.findIndex(([size]) => whole >= size);
  const [[size, unit], next] = [parts[first], parts[first + 1]];
  const rest = next ? Math.floor((whole % size) / next[0]) : 0;
  return `${sign}${Math.floor(whole / size)}${THIN}${unit}${rest ? ` ${rest}${THIN}${next[1]}` : ""}`;
}

/** Bench time as a clock, to as many decimals of a second as asked for: 9:04:05.2. */
export function clock(seconds, decimals = 0) {
  const sign = seconds < 0 ? "−" : "";
  const scale = 10 ** decimals;
  const ticks = Math.round(Math.abs(seconds) * scale);
  const whole = Math.floor(ticks / scale);
  const pad = (value) => String(value).padStart(2, "0");
  const fraction = decimals ? `.${String(ticks % scale).padStart(decimals, "0")}` : "";
  return `${sign}${Math.floor(whole / 3600)}:${pad(Math.floor(whole / 60) % 60)}:${pad(whole % 60)}${fraction}`;
}

/** A moment in the reader's zone, its UTC on hover. Takes ISO 8601; a stamp without a zone is UTC. */
export function moment(iso, { withDate = true, withSeconds = false } = {}) {
  const date = instant(iso);
  if (!date) return el("span", {}, iso || NOTHING);
  const day = withDate ? { day: "numeric", month: "short", year: "numeric" } : {};
  const seconds = withSeconds ? { second: "2-digit" } : {};
  const text = date.toLocaleString("en-GB", { ...day, hour: "2-digit", minute: "2-digit", ...seconds });
  const utc = `${date.toISOString().slice(0, 19).replace("T", " ")} UTC`;
  return el("time", { datetime: date.toISOString(), title: utc }, text);
}

/** A date from ISO 8601, or null. */
function instant(iso) {
  if (!iso) return null;
  const zoned = /(Z|[+-]\d\d:?\d\d)$/.test(iso) ? iso : `${iso}Z`;
  const date = new Date(zoned);
  return Number.isNaN(date.getTime()) ? null : date;
}

/** A number and its unit. */
export function joined(text, unit) {
  return unit && unit !== "1" ? `${text}${CLOSE.has(unit) ? "" : THIN}${unit}` : text;
}

/** A unit as people write it, of one as files keep it. */
export function unitName(unit) {
  return UNITS.reduce((name, [found, written]) => name.replace(found, written), unit ?? "").replace(/^1$/, "");
}

function known(value) {
  return typeof value === "number" && Number.isFinite(value);
}

function signed(text) {
  return text.replace("-", "−");
}

function raised(power) {
  return [...power].map((sign) => SUPERSCRIPT[sign]).join("");
}
