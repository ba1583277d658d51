// A calibration in short: its error level by level, its coefficients and how well they are known, where they hold.

import { el, fact, table } from "./dom.js";
import { measure, number, percent, unitName } from "./format.js";

const LEVELS = [
  ["raw", "Raw", "one straight line"],
  ["stage_1", "Stage 1", "with k(T) and k(ω)"],
  ["stage_2", "Stage 2", "and what sines leave"],
  ["joint", "Joint fit", "one law for all runs"],
];

/** The summary of `coefficients.json`. */
export function calibration(found) {
  const { error_percent: errors = {}, rms_percent: rms = {}, uncertainty, valid, joint } = found;
  return [
    el("h2", {}, "Largest error on runs that no fit has seen"),
    el(
      "ul",
      { class: "tiles levels" },
      LEVELS.filter(([key]) => Number.isFinite(errors[key])).map(([key, name, says]) =>
        el(
          "li",
          {},
          el("span", { class: "name" }, name),
          el("span", { class: "value" }, percent(errors[key] / 100, 2)),
          el(
            "span",
            { class: "more" },
            [says, Number.isFinite(rms[key]) && `rms ${percent(rms[key] / 100, 2)}`].filter(Boolean).join("; "),
          ),
        ),
      ),
    ),
    el("p", { class: "how" }, "Percent of the largest rate of the run."),
    parameters(uncertainty, joint?.parameters ?? {}),
    el("h2", {}, "Two-stage calibration"),
    el(
      "dl",
      { class: "facts" },
      fact("K0", measure(found.K0_v_per_dps, "V/(°/s)", 7)),
      fact("U0", measure(found.U0_v, "V", 6)),
      fact("T0", measure(found.T0_c, "°C", 4)),
      (found.stages ?? []).map((stage) => fact(stage.name, stageInWords(stage))),
      fact("Joint law", joint?.law),
      fact("Holds for rates", valid && range(valid.rate_dps, "°/s")),
      fact("Holds for temperatures", valid && range(valid.temperature_c, "°C")),
    ),
    remarks([...(found.warnings ?? []), ...(found.notes ?? [])]),
  ];
}

/** Remarks as a list; nothing where there are none. */
export function remarks(notes) {
  return notes.length
    ? [
        el("h2", {}, "Remarks"),
        el(
          "ul",
          {},
          notes.map((note) => el("li", {}, note)),
        ),
      ]
    : [];
}

function parameters(uncertainty, fitted) {
  const rows = Object.entries(uncertainty?.parameters ?? {}).map(([name, { value, unit, stated, ci95 }]) => [
    el("code", {}, name),
    fitted[name]?.says ?? "",
    [stated ?? measure(value, unitName(unit)), "n"],
    [ci95 ? `${number(ci95[0], 7)} to ${number(ci95[1], 7)}` : "", "n"],
  ]);
  return rows.length
    ? [
        el("h2", {}, "Coefficients"),
        table(
          `${uncertainty.of ?? "joint fit"}; ± is the expanded uncertainty, 95.45 %`,
          ["Name", "What it is", ["Value ± U", "n"], ["95 % by scatter", "n"]],
          rows,
        ),
      ]
    : [];
}

function stageInWords({ error_percent: error, K0_v_per_dps, delay_s }) {
  return [
    error && `error ${number(error.before, 3)} % before, ${number(error.after, 3)} % after`,
    K0_v_per_dps && `K0 ${measure(K0_v_per_dps, "V/(°/s)", 7)}`,
    delay_s && `delay ${measure(1000 * delay_s, "ms", 4)}`,
  ]
    .filter(Boolean)
    .join("; ");
}

function range([low, high], unit) {
  return `${measure(low, "", 4)} to ${measure(high, unit, 4)}`;
}
