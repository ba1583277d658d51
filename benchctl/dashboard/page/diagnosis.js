// A diagnosis in short: its verdict, the physics that the data demand, where the mismatch lives, the next run.

import { ApiError, get } from "./api.js";
import { command } from "./banners.js";
import { remarks } from "./calibration.js";
import { el, fact, fill, table } from "./dom.js";
import { measure, number, percent, unitName } from "./format.js";
import { residualMap } from "./map.js";
import { verdictChip } from "./status.js";

/** The summary of a diagnosis. */
export function diagnosis(found) {
  const { findings = [], unexplained, fit, next_experiment: next } = found;
  return [
    el("p", { class: "verdict" }, verdictChip(found.verdict), " ", found.says),
    findings.length > 0 &&
      el("h2", {}, findings.length === 1 ? "What is missing" : `What is missing: ${findings.length} findings`),
    findings.map(finding),
    unexplained?.significant && [el("h2", {}, "What remains unexplained"), el("p", {}, unexplained.says)],
    fit && fitted(fit),
    residualMap(found.map ?? []),
    next?.says && [
      el("h2", {}, "The next experiment"),
      el("p", {}, next.says),
      next.procedure && el("p", {}, command(nextCommand(next))),
    ],
    notFound(found.not_found ?? []),
    remarks(found.notes ?? []),
  ];
}

function finding(one) {
  const rows = Object.entries(one.parameters).map(([name, { value, ci95, unit }]) => [
    el("code", {}, name),
    [number(value, 5), "n"],
    [ci95[0] < ci95[1] ? `${number(ci95[0], 4)} to ${number(ci95[1], 4)}` : "given", "n"],
    unitName(unit),
  ]);
  const others = (one.alternatives ?? []).map(
    ({ effect, probability }) => `${named(effect)} (${percent(probability, 2)})`,
  );
  const where = one.where ?? {};
  return el(
    "section",
    { class: "finding" },
    el("h3", {}, named(one.effect), " ", el("small", {}, `probability ${percent(one.probability, 3)}`)),
    el("p", {}, one.says),
    explanation(one.effect),
    table("", ["Parameter", ["Value", "n"], ["95 % interval", "n"], "Unit"], rows, "dense"),
    el(
      "dl",
      { class: "facts" },
      fact(
        "Evidence",
        `gain ${number(one.gain, 4)} in twice the log likelihood, ${number(one.gain_heldout, 4)} on steps kept aside; ` +
          `explains ${percent(one.explains, 3)} of the mismatch`,
      ),
      fact(
        "Seen along",
        where.coordinate &&
          `${where.coordinate.replaceAll("_", " ")}${where.steps?.length ? `, most in ${where.steps.join(", ")}` : ""}`,
      ),
      fact("Or else", others.join(", ")),
    ),
  );
}

function explanation(effect) {
  const place = el("span", {});
  const button = el("button", { type: "button", class: "link", onclick: explain }, "What is this?");
  async function explain() {
    const { title, words, equation } = await get(`/api/explain/${encodeURIComponent(effect)}`).catch(knownAsNothing);
    const told = [title, words, equation].filter(Boolean);
    fill(
      place,
      told.map((text) => el("span", { class: "block" }, text)),
    );
    button.remove();
  }
  return el("p", { class: "how" }, button, place);
}

function knownAsNothing(error) {
  if (!(error instanceof ApiError)) throw error;
  return { words: error.message };
}

function fitted({ noise_v, before_v, after_v, heldout_before_v, heldout_after_v }) {
  const row = (name, rms) => [
    name,
    [measure(1000 * rms, "mV", 4), "n"],
    [noise_v ? number(rms / noise_v, 4) : "", "n"],
  ];
  return [
    el("h2", {}, "Before and after"),
    table(
      "Rms of the residual, beside the noise",
      ["Measured on", ["Rms", "n"], ["Over the noise", "n"]],
      [
        row("noise", noise_v),
        row("fitted steps, before", before_v),
        row("fitted steps, after", after_v),
        row("steps kept aside, before", heldout_before_v),
        row("steps kept aside, after", heldout_after_v),
      ],
      "dense",
    ),
  ];
}

function notFound(list) {
  if (!list.length) return [];
  const rows = list.map(({ effect, parameter, smallest, unit, says }) => [
    named(effect),
    smallest === null
      ? says || "not excited in this recording"
      : `${parameter.replaceAll("_", " ")} from ${measure(smallest, unitName(unit), 3)} on`,
  ]);
  return el(
    "details",
    {},
    el("summary", {}, `Looked for and not found: ${list.length}, and from which size each would have shown`),
    table("", ["Effect", "Would have shown"], rows, "dense"),
  );
}

function nextCommand({ procedure, parameters = {} }) {
  const given = Object.entries(parameters).map(
    ([name, value]) => `-p ${name}=${Array.isArray(value) ? value.join(",") : value}`,
  );
  return ["benchctl run", procedure, ...given].join(" ");
}

function named(effect) {
  return effect.replaceAll("_", " ");
}
