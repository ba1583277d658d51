// What was stated of a campaign, in short, and the way to the full report.

import { campaignPath, get } from "./api.js";
import { acceptance } from "./acceptance.js";
import { calibration } from "./calibration.js";
import { diagnosis } from "./diagnosis.js";
import { el, fill } from "./dom.js";
import { fullReport } from "./report.js";
import { signing } from "./sign.js";

/** The view of what `benchctl fit` stated. */
export function calibrationView(body, { campaign, signal }) {
  return documentView(body, campaign, "calibration", calibration, signal);
}

/** The view of what `benchctl diagnose` stated. */
export function diagnosisView(body, { campaign, signal }) {
  return documentView(body, campaign, "diagnosis", diagnosis, signal);
}

/** The view of what `benchctl accept` stated. */
export function acceptanceView(body, { campaign, signal }) {
  const again = () => acceptanceView(body, { campaign, signal });
  const summary = (found) => {
    const parts = [acceptance(found), signing(campaign, found, again)];
    return found.signed ? parts.reverse() : parts; // it is signed below what was read, and seen above
  };
  return documentView(body, campaign, "acceptance", summary, signal);
}

async function documentView(body, campaign, kind, summary, signal) {
  fill(body, await told(campaign, kind, summary, signal), fullReport(campaign, kind));
}

async function told(campaign, kind, summary, signal) {
  try {
    return summary(await get(campaignPath(campaign.id, `/documents/${kind}`), {}, signal));
  } catch (error) {
    if (error.status !== 404) throw error;
    return el("p", { class: "how" }, "Only the full report is kept here; its figures for programs are not beside it.");
  }
}
