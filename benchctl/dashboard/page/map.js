// The map of a mismatch: the residual's mean over each coordinate, before and after, beside what chance alone reaches.

import { el, svg } from "./dom.js";
import { number, small } from "./format.js";

const [WIDTH, HEIGHT, LEFT, TOP, BOTTOM] = [300, 140, 6, 15, 16];

/** Charts of slices `{coordinate, unit, edges, before, after, standard_error, threshold}`; residuals are in `measured`. */
export function residualMap(slices, measured) {
  if (!slices.length) return [];
  return [
    el("h2", {}, "Where the mismatch lives"),
    el(
      "p",
      { class: "how" },
      "Mean of the residual in bins of each coordinate: dashed before, solid after the findings; ",
      "grey: what chance alone reaches one time in a hundred.",
    ),
    el("div", { class: "maps" }, slices.map((one) => slice(one, measured))),
  ];
}

function slice({ coordinate, unit, edges, before, after, standard_error, threshold }, measured) {
  const chance = standard_error.map((error) => (error === null ? 0 : error * threshold));
  const most = Math.max(
    1e-12,
    ...[before, after, chance].flatMap((values) => values.filter(Number.isFinite).map(Math.abs)),
  );
  const [low, high] = [edges[0], edges.at(-1)];
  const x = (value) => LEFT + ((value - low) / (high - low || 1)) * (WIDTH - 2 * LEFT);
  const y = (value) => (1 - value / most) * ((HEIGHT - BOTTOM - TOP) / 2) + TOP;
  const line = (values, kind) =>
    svg("polyline", {
      class: kind,
      points: values
        .flatMap((value, bin) =>
          Number.isFinite(value) ? [`${x(edges[bin])},${y(value)}`, `${x(edges[bin + 1])},${y(value)}`] : [],
        )
        .join(" "),
    });
  const [most_before, most_after] = [before, after].map((values) => small(largest(values), measured));
  const says = `${coordinate.replaceAll("_", " ")}: at most ${most_before} before, ${most_after} after`;
  return el(
    "figure",
    { class: "chart" },
    el("h3", {}, coordinate.replaceAll("_", " "), unit && unit !== "1" ? `, ${unit}` : ""),
    svg(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": says },
      chance.map((size, bin) =>
        svg("rect", {
          class: "chance",
          x: x(edges[bin]),
          width: Math.max(0, x(edges[bin + 1]) - x(edges[bin])),
          y: y(size),
          height: y(-size) - y(size),
        }),
      ),
      svg("line", { class: "zero", x1: LEFT, x2: WIDTH - LEFT, y1: y(0), y2: y(0) }),
      line(before, "before"),
      line(after, "after"),
      svg("text", { x: LEFT, y: HEIGHT - 3 }, number(low, 4)),
      svg("text", { x: WIDTH / 2, y: HEIGHT - 3, "text-anchor": "middle" }, number((low + high) / 2, 4)),
      svg("text", { x: WIDTH - LEFT, y: HEIGHT - 3, "text-anchor": "end" }, number(high, 4)),
      svg("text", { x: LEFT, y: 10 }, small(most, measured)),
      svg("text", { x: LEFT, y: y(0) - 2 }, "0"),
      svg("text", { x: LEFT, y: y(-most) - 2 }, small(-most, measured)),
    ),
    el("figcaption", {}, says),
  );
}

function largest(values) {
  return Math.max(0, ...values.filter(Number.isFinite).map(Math.abs));
}
