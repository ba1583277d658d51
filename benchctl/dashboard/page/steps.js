// The steps of a campaign as a table; a click or Enter on one shows it.

import { el, table } from "./dom.js";
import { clock, count, duration, number } from "./format.js";
import { kindName } from "./timeline.js";

/** What a step asks of the table, in words. */
export function motion({ rate_dps, amplitude_dps, frequency_hz }) {
  const parts = [];
  if (Number.isFinite(rate_dps)) parts.push(`${number(rate_dps, 6)} °/s`);
  if (Number.isFinite(amplitude_dps)) parts.push(`peak ${number(amplitude_dps, 6)} °/s`);
  if (Number.isFinite(frequency_hz)) parts.push(`${number(frequency_hz, 4)} Hz`);
  return parts.join(", ");
}

/** All steps; `choose(step)` is called with the one that is to be shown. */
export function stepsTable(steps, choose) {
  const heads = ["Step", "Kind", "Motion", ["°C", "n"], ["Begins", "n"], ["Lasts", "n"], ["Samples", "n"], "State"];
  const rows = steps.map((step) => [
    el("button", { type: "button", class: "link", onclick: () => choose(step) }, `${step.index} ${step.name}`),
    kindName(step.kind),
    motion(step),
    [number(step.setpoint_c, 4), "n"],
    [clock(step.t_start_s), "n"],
    [duration(step.t_end_s - step.t_start_s), "n"],
    [count(step.samples), "n"],
    state(step),
  ]);
  return el(
    "details",
    { class: "steps", open: true },
    el("summary", {}, `${count(steps.length)} steps: choose one to see it`),
    table("", heads, rows, "dense"),
  );
}

function state({ whole, role, gaps, mounting }) {
  const told = [
    !whole && "✂ cut",
    role === "verify" && "kept aside for verification",
    gaps > 0 && `${count(gaps)} ${gaps === 1 ? "gap" : "gaps"}`,
    mounting && mounting !== "along" && `mounted ${mounting}`,
  ].filter(Boolean);
  return told.join(", ") || "whole";
}
