// A panel: the channels of one unit over bench time, drawn by uPlot, with what they are at the cursor below.

import { FONT, decimals, paddedRange, timeAxis, valueAxis } from "./axes.js";
import { el, say, svg } from "./dom.js";
import { clock, joined, number } from "./format.js";
import { STROKES, indexAt, points } from "./lines.js";
import { colour, theme } from "./theme.js";

const { uPlot } = window;
const NARROW = 560;
const RIGHT = 14;
const DOT_SPACE = 4;
const LABEL = 13;

/**
 * Channels `{name, label}` of one unit in one drawing; they may have a `width`, an `alpha`, and be `stepped`.
 *
 * `onSelect(from_s, to_s)` gets what is dragged over, `marks` are spans whose beginnings are ruled, `sync` joins the
 * cursors of the panels of one view, `least` is how much of the unit the drawing shows at least.
 */
export class Panel {
  constructor(
    place,
    { title = "", unit, channels, height = 160, sync = "panels", least = 0, onSelect = null, marks = [], signal },
  ) {
    Object.assign(this, { unit, channels, height, onSelect, marks, window: [0, 1], series: new Map(), nothing: "" });
    this.readings = channels.map(() => el("b", {}));
    this.at = el("span", { class: "at" });
    this.place = el("div", { class: "plot", role: "img" });
    this.root = el(
      "figure",
      { class: "panel" },
      el(
        "figcaption",
        {},
        el("span", { class: "unit" }, title || unit || "number"),
        channels.map((channel, index) =>
          el("span", { class: "legend" }, swatch(index), channel.label, " ", this.readings[index]),
        ),
        this.at,
      ),
      this.place,
    );
    place.append(this.root);
    this.chart = new uPlot(this.options(sync, least), this.data(), this.place);
    const resized = new ResizeObserver(() => this.fit());
    resized.observe(this.place);
    theme.addEventListener("change", () => this.chart.redraw(true, true), { signal });
    signal.addEventListener("abort", () => (resized.disconnect(), this.chart.destroy()));
  }

  /** How many pixels a line has. */
  get pixels() {
    return Math.max(50, Math.round(this.place.clientWidth) - this.axisWidth - RIGHT);
  }

  get axisWidth() {
    return this.place.clientWidth < NARROW ? 58 : 78;
  }

  /** Show these series, a map by name of channel, from `from_s` to `to_s`; without series only move the window. */
  show(from_s, to_s, series = null) {
    this.window = [from_s, to_s];
    if (series) this.series = series;
    this.chart.batch(() => {
      this.channels.forEach(({ name }, index) => {
        this.chart.series[index + 1].dash = this.series.get(name)?.exact ? STROKES[index % STROKES.length].dash : [];
      });
      this.chart.setData(this.data(), false);
      this.chart.setScale("x", { min: from_s, max: to_s });
    });
    this.place.setAttribute("aria-label", this.inWords());
    this.nothing = this.chart.data.slice(1).some((line) => line.length) ? "" : this.whyEmpty();
    const { left, top } = this.chart.cursor;
    this.chart.setCursor({ left, top }, true, false); // its dots lie on the lines that were there
  }

  whyEmpty() {
    const making = [...this.series.values()].some(({ complete }) => complete === false);
    return making ? "the overview is being made" : "no samples in this window";
  }

  data() {
    const pixel_s = (this.window[1] - this.window[0]) / this.pixels;
    const empty = [[], []];
    const lines = this.channels.map(({ name }) => {
      const series = this.series.get(name);
      return series ? points(series, series.pixel_s ?? pixel_s) : empty;
    });
    return lines.length === 1 ? lines[0] : uPlot.join(lines);
  }

  options(sync, least) {
    return {
      width: Math.max(200, this.place.clientWidth),
      height: this.height,
      legend: { show: false },
      padding: [6, RIGHT, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: (_, low, high) => paddedRange(low, high, least) } },
      cursor: {
        y: false,
        sync: { key: sync, filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
        drag: { x: Boolean(this.onSelect), y: false, setScale: false },
        points: { size: 7 },
      },
      axes: [timeAxis(), valueAxis(() => this.axisWidth)],
      series: [{}, ...this.channels.map((channel, index) => this.line(channel, index))],
      hooks: {
        setSelect: [(chart) => this.selected(chart)],
        setCursor: [(chart) => this.read(chart)],
        drawAxes: [(chart) => this.rule(chart)],
        draw: [(chart) => this.name(chart), (chart) => this.countTicks(chart)],
      },
    };
  }

  line(channel, index) {
    const { colour: name } = STROKES[index % STROKES.length];
    return {
      label: channel.label,
      stroke: () => colour(name),
      width: channel.width ?? 1.25,
      alpha: channel.alpha ?? 1,
      paths: channel.stepped ? uPlot.paths.stepped({ align: 1 }) : null,
      points: { show: () => this.hasDots(channel), size: 5, fill: () => colour(name) },
    };
  }

  hasDots({ name }) {
    const series = this.series.get(name);
    if (!series?.exact) return false;
    const inside = indexAt(series.t_s, this.window[1]) - indexAt(series.t_s, this.window[0]);
    return inside * DOT_SPACE <= this.pixels;
  }

  selected(chart) {
    const { left, width } = chart.select;
    if (width < 4) return;
    const [from_s, to_s] = [chart.posToVal(left, "x"), chart.posToVal(left + width, "x")];
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.onSelect?.(from_s, to_s);
  }

  read(chart) {
    const inside = chart.cursor.left >= 0;
    const t_s = chart.posToVal(chart.cursor.left, "x");
    say(this.at, inside ? `at ${clock(t_s, decimals((this.window[1] - this.window[0]) / 1000))}` : this.nothing);
    this.channels.forEach(({ name }, index) => say(this.readings[index], inside ? this.reading(name, t_s) : ""));
  }

  reading(name, t_s) {
    const series = this.series.get(name);
    const index = series ? indexAt(series.t_s, t_s) : -1;
    if (index < 0 || series.low[index] === null) return "–";
    const [low, high] = [series.low[index], series.high[index]];
    return joined(low === high ? number(low, 6) : `${number(low, 6)} … ${number(high, 6)}`, this.unit);
  }

  rule(chart) {
    const { ctx, bbox } = chart;
    const seen = this.marks.filter(({ t_start_s }) => t_start_s > this.window[0] && t_start_s < this.window[1]);
    if (seen.length > bbox.width / 12) return;
    ctx.save();
    ctx.strokeStyle = colour("--rule");
    ctx.lineWidth = devicePixelRatio;
    ctx.beginPath();
    for (const { t_start_s } of seen) {
      const x = Math.round(chart.valToPos(t_start_s, "x", true)) + 0.5;
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
    }
    ctx.stroke();
    ctx.restore();
  }

  name(chart) {
    if (this.channels.length < 2) return;
    const { ctx, bbox } = chart;
    const ends = this.channels.flatMap(({ label }, index) => {
      const last = chart.data[index + 1].findLast((value) => Number.isFinite(value));
      return last === undefined ? [] : [{ label, index, y: chart.valToPos(last, "y", true) }];
    });
    ctx.save();
    ctx.font = FONT.replace("12px", `bold ${Math.round(11.5 * devicePixelRatio)}px`);
    ctx.textAlign = "right";
    ends.sort((one, other) => one.y - other.y);
    const height = LABEL * devicePixelRatio;
    ends.forEach((end, place) => {
      const least = place ? ends[place - 1].y + height : bbox.top + height;
      end.y = Math.max(least, end.y - 0.4 * height);
    });
    const below = Math.max(0, ...ends.map(({ y }) => y - (bbox.top + bbox.height - 0.2 * height)));
    for (const { label, index, y } of ends) {
      ctx.strokeStyle = colour("--paper");
      ctx.lineWidth = 3 * devicePixelRatio;
      ctx.strokeText(label, bbox.left + bbox.width - 4 * devicePixelRatio, y - below);
      ctx.fillStyle = colour(STROKES[index % STROKES.length].colour);
      ctx.fillText(label, bbox.left + bbox.width - 4 * devicePixelRatio, y - below);
    }
    ctx.restore();
  }

  /** How many ticks the axes have, for whoever cannot see them. */
  countTicks(chart) {
    const [times, values] = chart.axes.map((axis) => axis._values?.filter(Boolean).length ?? 0);
    Object.assign(this.place.dataset, { timeTicks: times, valueTicks: values });
  }

  fit() {
    const width = Math.round(this.place.clientWidth);
    if (width && width !== this.chart.width) this.chart.setSize({ width, height: this.height });
  }

  inWords() {
    const [from_s, to_s] = this.window.map((t_s) => clock(t_s, decimals((this.window[1] - this.window[0]) / 100)));
    const said = this.channels.map(({ name, label }) => {
      const { low = [], high = [] } = this.series.get(name) ?? {};
      const [least, most] = extremes(low, high);
      return least > most
        ? `${label}: no samples`
        : `${label}: ${joined(number(least), this.unit)} to ${joined(number(most), this.unit)}`;
    });
    return `${said.join("; ")}; bench time ${from_s} to ${to_s}.`;
  }
}

function swatch(index) {
  const { colour: name, dash } = STROKES[index % STROKES.length];
  const line = svg("line", {
    x1: 0,
    x2: 26,
    y1: 5,
    y2: 5,
    "stroke-dasharray": dash.join(" ") || null,
    class: name.slice(2),
  });
  return svg("svg", { class: "swatch", viewBox: "0 0 26 10", "aria-hidden": "true" }, line);
}

function extremes(low, high) {
  let [least, most] = [Infinity, -Infinity];
  for (let index = 0; index < low.length; index += 1) {
    if (low[index] !== null && low[index] < least) least = low[index];
    if (high[index] !== null && high[index] > most) most = high[index];
  }
  return [least, most];
}
