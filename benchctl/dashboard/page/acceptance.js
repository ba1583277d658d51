// An acceptance in short: its verdict, and each test with its value, its limit and what was made of it.

import { el, fact, table } from "./dom.js";
import { moment, number, unitName } from "./format.js";
import { remarks } from "./calibration.js";
import { verdictChip } from "./status.js";

/** The summary of `acceptance.json`. */
export function acceptance(found) {
  const { tests } = found;
  const rows = tests.map((test) => [
    test.name.replaceAll("_", " "),
    test.verdict ? verdictChip(test.verdict) : Number.isFinite(test.value) ? "no limit" : "not measured",
    [test.stated ?? number(test.value), "n"],
    limit(test.limit),
    [test.remedy || test.refused || "", "wide"],
  ]);
  return [
    el(
      "p",
      { class: "verdict" },
      verdictChip(found.verdict),
      ` ${found.tally ?? ""}`,
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
      "Values with their expanded uncertainty, 95.45 %",
      [
        "Test",
          "Verdict",
          ["Value ± U", "n"],
        "Limit",
        ["What would settle it, or why there is no value", "wide"],
      ],
      rows,
    ),
    remarks(found.anomalies ?? []),
  ];
}

function limit(found) {
  if (!found) return "";
  const unit = found.unit === "1" ? "" : ` ${unitName(found.unit)}`;
  if (found.low === null) return `at most ${number(found.high)}${unit}`;
  if (found.high === null) return `at least ${number(found.low)}${unit}`;
  return `${number(found.low)} to ${number(found.high)}${unit}`;
}
