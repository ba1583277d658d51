// An acceptance in short: its verdict, and each test with its value, its limit and what was made of it.

import { el, fact, table } from "./dom.js";
import { moment, number, stated, unitName } from "./format.js";
import { remarks } from "./calibration.js";
import { verdictChip } from "./status.js";

const BOUNDS = { "at least": "≥ ", "at most": "≤ " };

/** The summary of `acceptance.json`. */
export function acceptance(found) {
  const { tests } = found;
  const judged = (verdict) => tests.filter((test) => test.verdict === verdict).length;
  const unlimited = tests.filter((test) => !test.verdict).length;
  const rows = tests.map((test) => [
    test.name.replaceAll("_", " "),
    ...valueOf(test).map((text) => [text, "n"]),
    unitName(test.unit),
    limit(test.limit),
    test.verdict ? verdictChip(test.verdict) : "no limit",
    test.remedy || test.refused || "",
  ]);
  return [
    el(
      "p",
      { class: "verdict" },
      verdictChip(found.verdict),
      ` ${judged("PASS")} pass, ${judged("FAIL")} fail, ${judged("INCONCLUSIVE")} inconclusive, `,
      `${unlimited} without a limit`,
    ),
    el(
      "dl",
      { class: "facts" },
      fact("Rule", found.rule?.says),
      fact("Limits", found.limits?.file),
      fact("Stage", found.stage),
      fact("Recorded", found.started_utc && moment(found.started_utc)),
    ),
    table(
      "Values with their expanded uncertainty, k = 2",
      [
        "Test",
        ["Value", "n"],
        ["U", "n"],
        "Unit",
        "Limit",
        "Verdict",
        "What would settle it, or why there is no value",
      ],
      rows,
    ),
    remarks(found.anomalies ?? []),
  ];
}

function valueOf({ value, uncertainty, bound }) {
  if (!Number.isFinite(value)) return ["–", ""];
  const [text, half] = stated(value, uncertainty);
  return [`${BOUNDS[bound] ?? ""}${text}`, uncertainty > 0 ? `± ${half}` : ""];
}

function limit(found) {
  if (!found) return "";
  const unit = found.unit === "1" ? "" : ` ${unitName(found.unit)}`;
  if (found.low === null) return `at most ${number(found.high)}${unit}`;
  if (found.high === null) return `at least ${number(found.low)}${unit}`;
  return `${number(found.low)} to ${number(found.high)}${unit}`;
}
