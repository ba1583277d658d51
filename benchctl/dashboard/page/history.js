// Units over time: what calibrations and acceptances said of each, and what is to be looked at.

import { get } from "./api.js";
import { el, fill, svg } from "./dom.js";
import { fixed, measure, moment, number, unitName } from "./format.js";
import { verdictChip } from "./status.js";

const [WIDTH, HEIGHT, PAD] = [300, 110, 8];

/** The view of `#/history`. */
export async function historyView(root, { query, signal }) {
  fill(
    root,
    el("div", { class: "title" }, el("h1", {}, "Units over time")),
    el("p", { class: "nothing" }, "Reading the documents …"),
  );
  const { units, problems } = await get("/api/history", {}, signal);
  const search = el("input", {
    type: "search",
    id: "find-unit",
    value: query.get("unit"),
    oninput: draw,
    placeholder: "unit or model",
  });
  const list = el("div", {});

  function draw() {
    const words = search.value.toLowerCase();
    const found = units.filter((unit) => `${unit.serial} ${unit.model}`.toLowerCase().includes(words));
    fill(
      list,
      found.length
        ? found.map(unitCard)
        : el("p", { class: "nothing" }, "No unit of this name was calibrated or accepted here."),
    );
  }

  fill(
    root,
    el(
      "div",
      { class: "title" },
      el("h1", {}, "Units over time"),
      el("span", { class: "gap" }),
      el("label", { class: "search", for: "find-unit" }, "Search ", search),
    ),
    list,
    problems.length > 0 &&
      el(
        "details",
        {},
        el("summary", {}, `${problems.length} not counted`),
        el(
          "ul",
          {},
          problems.map(({ where, says }) => el("li", {}, el("code", {}, where), `: ${says}`)),
        ),
      ),
  );
  draw();
}

function unitCard(unit) {
  const flags = unit.figures.flatMap((figure) => figure.flags.map((flag) => `${figure.name}: ${flag.says}`));
  return el(
    "section",
    { class: "unit-card" },
    el("h2", {}, unit.serial, " ", el("small", {}, unit.model), " ", unit.verdict && verdictChip(unit.verdict)),
    el(
      "p",
      { class: "how" },
      `${unit.campaigns.length} campaigns${unverified(unit)}; the last one `,
      moment(unit.campaigns.at(-1)?.started_utc),
    ),
    flags.length > 0 &&
      el(
        "ul",
        { class: "flags" },
        [...new Set(flags)].map((says) => el("li", {}, "⚑ ", says)),
      ),
    unit.figures.length
      ? el("div", { class: "charts" }, unit.figures.map(chart))
      : el("p", { class: "how" }, "Nothing was stated of it yet: benchctl fit, benchctl accept."),
  );
}

function unverified({ campaigns }) {
  const number = campaigns.filter(({ integrity }) => integrity !== "verified").length;
  return number ? ` (${number} not verified: no manifest names them)` : "";
}

function chart(figure) {
  const unit = unitName(figure.unit);
  const latest = figure.points.at(-1);
  const { control, drift, siblings } = figure;
  const caption = [
    control && `control limits ${number(control.low)} to ${measure(control.high, unit)}`,
    drift && `since the last: ${measure(drift.difference, unit, 3)}`,
    Number.isFinite(drift?.e_n) && `E_n ${fixed(drift.e_n, 2)}`,
    Number.isFinite(siblings?.z) && `z beside its siblings ${fixed(siblings.z, 1)}`,
  ];
  return el(
    "figure",
    { class: figure.flags.length ? "chart flagged" : "chart" },
    el("h3", {}, figure.source === "acceptance" ? figure.name.replaceAll("_", " ") : figure.name),
    el("p", { class: "now" }, latest.stated),
    figure.points.length > 1 && drawing(figure, unit),
    el("figcaption", {}, caption.filter(Boolean).join("; ")),
  );
}

function drawing({ name, points, control }, unit) {
  const times = points.map((point) => Date.parse(point.started_utc));
  const spread = points.flatMap(({ value, uncertainty }) => [value - (uncertainty ?? 0), value + (uncertainty ?? 0)]);
  if (control) spread.push(control.low, control.high);
  const x = scaled(times, PAD, WIDTH - PAD);
  const y = scaled(spread, HEIGHT - PAD, PAD);
  const level = (value, kind) => svg("line", { class: kind, x1: 0, x2: WIDTH, y1: y(value), y2: y(value) });
  const range = [Math.min(...spread), Math.max(...spread)].map((value) => measure(value, unit)).join(" to ");
  return svg(
    "svg",
    {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      role: "img",
      "aria-label": `${name}: ${points.length} values, ${range}`,
    },
    control && [level(control.centre, "centre"), level(control.low, "control"), level(control.high, "control")],
    svg("polyline", {
      class: "run",
      points: points.map((point, index) => `${x(times[index])},${y(point.value)}`).join(" "),
    }),
    points.map((point, index) =>
      svg(
        "g",
        { class: point.verdict === "FAIL" ? "fails" : null },
        svg(
          "title",
          {},
          `${point.started_utc}: ${measure(point.value, unit)}${point.verdict ? `, ${point.verdict}` : ""}`,
        ),
        Number.isFinite(point.uncertainty) &&
          svg("line", {
            class: "bar",
            x1: x(times[index]),
            x2: x(times[index]),
            y1: y(point.value - point.uncertainty),
            y2: y(point.value + point.uncertainty),
          }),
        point.verdict === "FAIL"
          ? svg("path", { d: `M${x(times[index]) - 4} ${y(point.value) - 4} l8 8 m0 -8 l-8 8` })
          : svg("circle", { cx: x(times[index]), cy: y(point.value), r: 3 }),
      ),
    ),
  );
}

function scaled(values, from, to) {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return (value) => (high > low ? from + ((value - low) / (high - low)) * (to - from) : (from + to) / 2);
}
