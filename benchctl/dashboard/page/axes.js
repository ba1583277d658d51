// The axes of plots: bench time below, values at the left, as many decimals as their steps take.

import { clock, fixed } from "./format.js";
import { colour } from "./theme.js";

/** The lettering of plots. */
export const FONT = "12px 'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif";
/** Steps of bench time that a person counts in, in seconds. */
export const STEPS_S = [
  1e-6, 1e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300,
  600, 1200, 1800, 3600, 7200, 14400, 21600, 43200, 86400, 172800, 604800,
];
const STEPS = Array.from({ length: 31 }, (_, power) => [1, 2, 5].map((step) => Number(`${step}e${power - 15}`))).flat();
const LEAST_TICKS = 3;

/** Bench time as a clock. */
export function timeAxis() {
  return {
    ...axisLook(),
    size: 28,
    splits: (chart, _, low, high) => ticksIn(low, high, STEPS_S, chart.bbox.width / devicePixelRatio / 78),
    values: (_, splits) => splits.map((t_s) => clock(t_s, decimals(splits[1] - splits[0]))),
  };
}

/** Values; `size()` is how wide their numbers may be. */
export function valueAxis(size) {
  return {
    ...axisLook(),
    size,
    splits: (chart, _, low, high) => ticksIn(low, high, STEPS, chart.bbox.height / devicePixelRatio / 24),
    values: (chart, splits) => {
      const isEmpty = chart.data.slice(1).every((line) => !line.length);
      return splits.map((value) => (isEmpty ? "" : fixed(value, decimals(splits[1] - splits[0]))));
    },
  };
}

/** Multiples of one of the steps from `low` to `high`: about `most` of them where that is enough, at least three. */
export function ticksIn(low, high, steps, most) {
  const wide = high - low;
  const fits = steps.findIndex((step) => wide / step <= most);
  for (let place = fits < 0 ? steps.length - 1 : fits; place >= 0; place -= 1) {
    const step = steps[place];
    const first = Math.ceil(low / step - 1e-9);
    const count = Math.floor(high / step + 1e-9) - first + 1;
    if (count >= LEAST_TICKS) return Array.from({ length: count }, (_, index) => (first + index) * step);
  }
  return [low, (low + high) / 2, high];
}

/** How many decimals tell values apart that are whole steps of this size. */
export function decimals(step) {
  let places = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  const scaled = step * 10 ** places;
  if (Math.abs(scaled - Math.round(scaled)) > 1e-6) places += 1; // 0.25, 2.5
  return Math.min(9, places);
}

/** A range of values with some paper around it, `least` wide at least, also where they are all the same or none. */
export function paddedRange(low, high, least) {
  if (low === null || high === null) return [0, 1];
  const wide = high > low ? 1.12 * (high - low) : 0.02 * Math.abs(low) || 2;
  const half = Math.max(wide, least) / 2;
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

function axisLook() {
  return {
    stroke: () => colour("--soft"),
    font: FONT,
    grid: { stroke: () => colour("--grid"), width: 1 },
    ticks: { stroke: () => colour("--grid"), width: 1, size: 4 },
  };
}
