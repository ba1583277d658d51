// A campaign's status as a word, a shape and a level: never by colour alone.

import { el, svg } from "./dom.js";

const KINDS = {
  running: ["running", "going", "M3 2 L13 8 L3 14 Z"],
  died: ["died", "bad", "M3 3 L13 13 M13 3 L3 13"],
  complete: ["complete", "good", "M2.5 8.5 L6.5 12.5 L13.5 4"],
  interrupted: ["interrupted", "warn", "M4.5 3 V13 M11.5 3 V13"],
  aborted: ["aborted", "bad", "M8 2 L14.5 13.5 H1.5 Z"],
  imported: ["imported", "plain", "M8 2 V11 M4 7.5 L8 11.5 L12 7.5 M3 14 H13"],
  simulated: ["simulated", "plain", "M1.5 8 C4 1.5 6 1.5 8 8 S12 14.5 14.5 8"],
  unreadable: ["unreadable", "bad", "M4 4 H12 V12 H4 Z M4 4 L12 12"],
};

/** The status of a campaign as a chip. */
export function statusChip(status) {
  const [word, level, path] = KINDS[status] ?? [status, "plain", "M8 2 A6 6 0 1 1 7.99 2"];
  return chip(word, level, path);
}

/** A verdict (PASS, FAIL, INCONCLUSIVE or a diagnosis') as a chip. */
export function verdictChip(verdict) {
  const [level, path] = {
    PASS: ["good", KINDS.complete[2]],
    FAIL: ["bad", KINDS.died[2]],
    INCONCLUSIVE: ["warn", "M5 5.5 C5 2 11 2 11 5.5 C11 8 8 7.5 8 10.5 M8 13.2 V13.4"],
    consistent: ["good", KINDS.complete[2]],
    recalibrate: ["warn", "M13 8 A5 5 0 1 1 8 3 M8 3 L10.5 1 M8 3 L10.5 5.5"],
    "missing-physics": ["orange", "M8 2 V14 M2 8 H14"],
    "unknown-structure": ["purple", "M5 5.5 C5 2 11 2 11 5.5 C11 8 8 7.5 8 10.5 M8 13.2 V13.4"],
  }[verdict] ?? ["plain", "M3 8 H13"];
  return chip(verdict ?? "no limit", level, path);
}

/** That a file of a campaign is not as it was when the campaign was sealed. */
export function alteredChip() {
  return chip("altered", "bad", KINDS.aborted[2]);
}

/** Whether somebody may still be watched or waited for. */
export function isLive(campaign) {
  return campaign.status === "running" || campaign.status === "died";
}

function chip(word, level, path) {
  return el(
    "span",
    { class: `chip ${level}` },
    svg("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, svg("path", { d: path })),
    el("span", {}, word),
  );
}
