// A diagnosis in short: its verdict, the physics that the data demand, where the mismatch lives, the next run.

import { ApiError, get } from "./api.js";
import { command } from "./banners.js";
import { remarks } from "./calibration.js";
import { el, fact, fill, table } from "./dom.js";
import { measure, number, percent, small, unitName } from "./format.js";
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
    residualMap(found.map ?? [], unitName(fit?.unit ?? "")),
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
  const rows = Object.entries(one.parameters).map(([name, { value, ci95, unit, stated }]) => [
    el("code", {}, name),
    [stated ?? measure(value, unitName(unit)), "n"],
    [ci95[0] < ci95[1] ? `${number(ci95[0], 4)} to ${number(ci95[1], 4)}` : "given", "n"],
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
    table("", ["Parameter", ["Value ± half the interval", "n"], ["95 % interval", "n"]], rows, "dense"),
    el(
      "dl",
      { class: "facts" },
      fact(
        "Evidence",
        `gain ${number(one.gain, 4)} in twice the log likelihood, ${number(one.gain_heldout, 4)} on steps kept aside; ` +
          `explains ${percent(one.explains, 3)} of the mismatch`,
      ),
      fact(
        "Depends on",
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

function fitted({ unit, noise, before, after, heldout_before, heldout_after }) {
  const row = (name, rms) => [name, [small(rms, unitName(unit)), "n"], [noise ? number(rms / noise, 4) : "", "n"]];
  return [
    el("h2", {}, "Before and after"),
    table(
      "Rms of the residual, beside the noise",
      ["Measured on", ["Rms", "n"], ["Over the noise", "n"]],
      [
        row("noise", noise),
        row("fitted steps, before", before),
        row("fitted steps, after", after),
        row("steps kept aside, before", heldout_before),
        row("steps kept aside, after", heldout_after),
      ],
      "dense",
    ),
  ];
}

function notFound(list) {
  if (!list.length) return [];
  const rows = list.map(({ effect, parameter, would_show_from: { value, unit } }) => [
    named(effect),
    `${parameter.replaceAll("_", " ")} from ${measure(value, unitName(unit), 3)} on`,
  ]);
  return el(
    "details",
    {},
    el("summary", {}, `Looked for and not found: ${list.length}, and from which size each was found again once added`),
    table("", ["Effect", "Found again"], rows, "dense"),
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
