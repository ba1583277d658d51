// What is measured just now, in figures, and how near each limit is, in bars and words.

import { el, fill, say } from "./dom.js";
import { fixed, joined, measure, small, unitName } from "./format.js";

const VALUES = [
  ["setpoint_c", "Set point", (value) => joined(fixed(value, 1), "°C")],
  ["air_c", "Chamber air", (value) => joined(fixed(value, 2), "°C")],
  ["gyro_c", "Gyro", (value) => joined(fixed(value, 2), "°C")],
  ["rate_dps", "Rate", (value) => joined(fixed(value, 2), "°/s")],
  ["gyro_v", "Output", (value) => joined(fixed(value, 5), "V")],
  ["noise_v_rms", "Noise, rms", (value) => small(value, "V")],
];
const NEAR = 0.1;
const HOW = { beyond: "BEYOND", near: "near the end of", far: "inside", unknown: "of" };
const QUANTITIES = {
  rate_dps: "rate of the table",
  acceleration_dps2: "acceleration",
  angle_deg: "angle of the table",
  encoder_dps: "rate by encoder",
  air_c: "chamber air",
  setpoint_c: "set point",
  setpoint_error_c: "air off set point",
  power_percent: "heater",
  gyro_c: "gyro",
  gyro_v: "gyro’s output",
};

/** The figures. */
export class Readings {
  constructor() {
    this.values = VALUES.map(() => el("span", { class: "value" }));
    this.over = el("p", { class: "how" });
    const tiles = VALUES.map(([, name], index) =>
      el("li", {}, el("span", { class: "name" }, name), this.values[index]),
    );
    this.root = el("div", {}, el("ul", { class: "tiles", "aria-label": "measured now" }, tiles), this.over);
  }

  /** Show values by name; what is null is not known. */
  show(values, noiseSays) {
    VALUES.forEach(([key, , told], index) =>
      say(this.values[index], Number.isFinite(values[key]) ? told(values[key]) : "–"),
    );
    say(this.over, noiseSays && `Noise: ${noiseSays}.`);
  }
}

/** The limits of the bench. */
export class Limits {
  constructor() {
    this.root = el("ul", { class: "limits", "aria-label": "limits" }, el("li", {}, "No limit is known."));
    this.rows = [];
  }

  /** Show limits `{quantity, unit, value, low, high, margin}`, always the same ones in the same order. */
  show(limits) {
    if (limits.length !== this.rows.length) {
      this.rows = limits.map(({ quantity }) => new Row(QUANTITIES[quantity] ?? quantity.replaceAll("_", " ")));
      fill(
        this.root,
        this.rows.map(({ root }) => root),
      );
    }
    limits.forEach((limit, index) => this.rows[index].show(limit));
  }
}

class Row {
  constructor(name) {
    this.used = el("i", {});
    this.words = el("span", {});
    const label = `${name}: percent of the way to the limit`;
    const meter = { class: "meter", role: "meter", "aria-label": label, "aria-valuemin": 0, "aria-valuemax": 100 };
    this.meter = el("div", meter, this.used);
    this.root = el("li", {}, el("span", { class: "name" }, name), this.meter, this.words);
  }

  show(limit) {
    const used = Number.isFinite(limit.margin) ? Math.min(1, Math.max(0, 1 - limit.margin)) : 0;
    this.root.className = levelOf(limit.margin);
    this.meter.setAttribute("aria-valuenow", String(Math.round(100 * used)));
    this.used.style.width = `${100 * used}%`;
    say(this.words, inWords(limit));
  }
}

function levelOf(margin) {
  if (!Number.isFinite(margin)) return "unknown";
  return margin < 0 ? "beyond" : margin < NEAR ? "near" : "far";
}

function inWords({ value, low, high, unit, margin }) {
  const name = unitName(unit);
  const range = rangeInWords(low, high, name);
  if (!Number.isFinite(value)) return `${range}; not measured yet`;
  return `${measure(value, name, 4)}: ${HOW[levelOf(margin)]} ${range}`;
}

function rangeInWords(low, high, unit) {
  if (low === null) return `at most ${measure(high, unit)}`;
  if (high === null) return `at least ${measure(low, unit)}`;
  return low === -high ? `±${measure(high, unit)}` : `${measure(low, "")} to ${measure(high, unit)}`;
}
