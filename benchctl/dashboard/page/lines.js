// From the server's minima and maxima to the points of a line, and which line is drawn how.

const GAP = 8;

/** How channels of one panel differ: by colour and by dashes. */
export const STROKES = [
  { colour: "--series-1", dash: [] },
  { colour: "--series-2", dash: [7, 3] },
  { colour: "--series-3", dash: [2, 2] },
  { colour: "--series-4", dash: [10, 3, 2, 3] },
  { colour: "--series-5", dash: [4, 4] },
  { colour: "--series-6", dash: [14, 4] },
];

/**
 * The points [x, y] of a series `{t_s, low, high, exact}`, `pixel_s` seconds to a pixel.
 *
 * Exact samples are points, with a gap where the next one is much farther than they usually are. Otherwise each pixel
 * is a stroke from its minimum to its maximum, and pixels without samples are a gap; but what is polled every few
 * pixels, single samples at their usual distance, is a line all the same.
 */
export function points({ t_s, low, high, exact }, pixel_s) {
  const line = [[], []];
  if (exact) exactPoints(t_s, low, pixel_s, line);
  else strokes(t_s, low, high, pixel_s, line);
  return line;
}

/** The index of the last time that is not after `t`, or -1. */
export function indexAt(times, t) {
  let [first, after] = [0, times.length];
  while (first < after) {
    const middle = (first + after) >> 1;
    if (times[middle] <= t) first = middle + 1;
    else after = middle;
  }
  return first - 1;
}

function exactPoints(t_s, values, pixel_s, [xs, ys]) {
  const widest_s = GAP * usual(t_s);
  for (let index = 0; index < t_s.length; index += 1) {
    const before = index > 0 && t_s[index] - t_s[index - 1] > widest_s;
    const after = index + 1 < t_s.length && t_s[index + 1] - t_s[index] > widest_s;
    xs.push(t_s[index]);
    ys.push(values[index]);
    if ((before || index === 0) && (after || index + 1 === t_s.length)) {
      xs.push(t_s[index] + 0.5 * Math.min(pixel_s, widest_s || pixel_s)); // alone, it would be no line at all
      ys.push(values[index]);
    }
    if (after) {
      xs.push((t_s[index] + t_s[index + 1]) / 2);
      ys.push(null);
    }
  }
}

function strokes(t_s, low, high, pixel_s, [xs, ys]) {
  const filled = low.flatMap((value, index) => (value === null ? [] : [index]));
  const single = new Set(filled.filter((index) => low[index] === high[index] && (low[index - 1] ?? null) === null));
  const bridged = 3 * usual([...single]);
  filled.forEach((index, place) => {
    const before = filled[place - 1] ?? index;
    const isBridged = single.has(before) && single.has(index) && index - before <= bridged;
    if (index - before > 1 && !isBridged) {
      xs.push(t_s[before] + pixel_s);
      ys.push(null);
    }
    xs.push(t_s[index] + 0.25 * pixel_s, t_s[index] + 0.75 * pixel_s);
    ys.push(low[index], high[index]);
  });
}

function usual(times) {
  if (times.length < 3) return 0;
  const steps = Float64Array.from({ length: times.length - 1 }, (_, index) => times[index + 1] - times[index]).sort();
  return steps[steps.length >> 1];
}
