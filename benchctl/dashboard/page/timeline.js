// A campaign over bench time: the chamber's set point, below it one lane for each kind of step.

import { STEPS_S, decimals, ticksIn } from "./axes.js";
import { el, fill, say, svg } from "./dom.js";
import { clock, duration, fixed } from "./format.js";

const KIND_NAMES = {
  soak: "soak",
  static: "at rest",
  constant_rate: "constant rate",
  sine: "sine",
  thermal_ramp: "thermal ramp",
  power_cycle: "power cycle",
  mount: "mounted by hand",
  ask: "done by an operator",
  motion: "motion",
  static_points: "static points",
  unassigned: "unassigned",
};
const LEFT = 92;
const RIGHT = 12;
const TOP = 6;
const SETPOINT_HEIGHT = 34;
const LANE = 12;
const AXIS_HEIGHT = 16;

/** The word for a kind of step. */
export function kindName(kind) {
  return KIND_NAMES[kind] ?? kind;
}

/** Draws spans `{index, label, kind, t_start_s, t_end_s, setpoint_c}` in `place`; `onChoose` gets the one clicked. */
export class Timeline {
  constructor(place, spans, { onChoose = null, signal }) {
    this.spans = spans;
    this.end_s = Math.max(1e-9, ...spans.map((span) => span.t_end_s));
    this.kinds = Object.keys(KIND_NAMES).filter((kind) => spans.some((span) => span.kind === kind));
    this.kinds.push(...new Set(spans.map((span) => span.kind).filter((kind) => !this.kinds.includes(kind))));
    this.height = TOP + SETPOINT_HEIGHT + this.kinds.length * LANE + AXIS_HEIGHT + 6;
    this.drawing = svg("svg", { class: "timeline", role: "img", "aria-label": this.inWords(), height: this.height });
    this.under = el("p", { class: "how" });
    this.now_s = null;
    this.window = null;
    fill(place, this.drawing, this.under);
    this.drawing.addEventListener("mousemove", (event) => this.tell(this.spanAt(event)));
    this.drawing.addEventListener("mouseleave", () => this.tell(null));
    if (onChoose) {
      this.drawing.classList.add("chooses");
      this.drawing.addEventListener("click", (event) => this.spanAt(event) && onChoose(this.spanAt(event)));
    }
    const resized = new ResizeObserver(() => this.draw());
    resized.observe(place);
    signal.addEventListener("abort", () => resized.disconnect());
    this.tell(null);
  }

  /** Mark where the run is, in bench time; `spans` are the same ones where they have moved since. */
  showNow(now_s, spans = null) {
    if (spans) this.spans = spans;
    this.end_s = Math.max(1e-9, now_s, ...this.spans.map((span) => span.t_end_s));
    this.now_s = now_s;
    this.drawing.setAttribute("aria-label", this.inWords());
    this.draw();
  }

  /** Mark the window that plots show. */
  showWindow(from_s, to_s) {
    this.window = from_s <= 0 && to_s >= this.end_s ? null : [from_s, to_s];
    this.draw();
  }

  draw() {
    const width = this.drawing.parentElement.clientWidth;
    if (!width) return;
    this.drawing.setAttribute("width", width);
    this.scale = (width - LEFT - RIGHT) / this.end_s;
    fill(this.drawing, this.axis(), this.setpoints(), this.lanes(), this.marks());
  }

  axis() {
    const ticks = ticksIn(0, this.end_s, STEPS_S, (this.end_s * this.scale) / 70);
    const places = decimals(ticks[1] - ticks[0]);
    const bottom = this.height - AXIS_HEIGHT;
    return ticks.map((tick) => [
      svg("line", { class: "grid", x1: this.x(tick), x2: this.x(tick), y1: TOP, y2: bottom }),
      svg(
        "text",
        { x: this.x(tick), y: this.height - 3, "text-anchor": tick ? "middle" : "start" },
        ticks[1] % 60 ? clock(tick, places) : clock(tick).slice(0, -3),
      ),
    ]);
  }

  setpoints() {
    const known = this.spans.filter((span) => Number.isFinite(span.setpoint_c));
    if (!known.length) return svg("text", { x: LEFT, y: TOP + 20 }, "no set point is known");
    const low = Math.min(...known.map((span) => span.setpoint_c));
    const high = Math.max(...known.map((span) => span.setpoint_c));
    const middle = TOP + SETPOINT_HEIGHT / 2;
    const y = (value) => (high > low ? TOP + 5 + ((high - value) / (high - low)) * (SETPOINT_HEIGHT - 10) : middle);
    const points = known.flatMap((span) =>
      [span.t_start_s, span.t_end_s].map((t) => `${this.x(t)},${y(span.setpoint_c)}`),
    );
    const names = high > low ? [high, low] : [high];
    return [
      svg("text", { x: 0, y: middle + 4 }, "set point"),
      names.map((value) => svg("text", { x: LEFT - 5, y: y(value) + 4, "text-anchor": "end" }, `${fixed(value, 0)}°`)),
      svg("polyline", { class: "setpoint", points: points.join(" ") }),
    ];
  }

  lanes() {
    const top = TOP + SETPOINT_HEIGHT;
    return this.kinds.map((kind, lane) => [
      svg("text", { x: 0, y: top + lane * LANE + LANE - 2 }, kindName(kind)),
      this.spans
        .filter((span) => span.kind === kind)
        .map((span) =>
          svg("rect", {
            class: `kind-${kind}${span.t_start_s > (this.now_s ?? Infinity) ? " to-come" : ""}`,
            x: this.x(span.t_start_s),
            y: top + lane * LANE + 2,
            width: Math.max(1, (span.t_end_s - span.t_start_s) * this.scale),
            height: LANE - 3,
          }),
        ),
    ]);
  }

  marks() {
    const bottom = this.height - AXIS_HEIGHT;
    const box =
      this.window &&
      svg("rect", {
        class: "window",
        x: this.x(this.window[0]),
        y: TOP - 2,
        height: bottom - TOP + 2,
        width: Math.max(2, (this.window[1] - this.window[0]) * this.scale),
      });
    const now = this.now_s !== null && [
      svg("line", { class: "now", x1: this.x(this.now_s), x2: this.x(this.now_s), y1: 0, y2: bottom }),
      svg("path", { class: "now", d: `M${this.x(this.now_s) - 5} 0 h10 l-5 7 z` }),
    ];
    return [box, now].filter(Boolean);
  }

  x(t_s) {
    return LEFT + t_s * this.scale;
  }

  spanAt(event) {
    const t_s = (event.clientX - this.drawing.getBoundingClientRect().left - LEFT) / this.scale;
    return this.spans.find((span) => t_s >= span.t_start_s && t_s <= span.t_end_s) ?? null;
  }

  tell(span) {
    say(
      this.under,
      span ? `step ${span.index}: ${span.label}, ${clock(span.t_start_s)} to ${clock(span.t_end_s)}` : "",
    );
  }

  inWords() {
    const numbers = this.kinds.map(
      (kind) => `${this.spans.filter((span) => span.kind === kind).length} ${kindName(kind)}`,
    );
    return `The campaign over ${duration(this.end_s)} of bench time: ${numbers.join(", ")}.`;
  }
}
