// One campaign: what it is, and its pages: live while it runs, then plots, the documents about it, events, provenance.

import { campaignPath, get } from "./api.js";
import { el, fact, fill } from "./dom.js";
import { acceptanceView, calibrationView, diagnosisView } from "./documents.js";
import { eventsView } from "./events.js";
import { exploreView } from "./explore.js";
import { count, duration, moment } from "./format.js";
import { onKeys } from "./keys.js";
import { liveView } from "./live.js";
import { go, link } from "./router.js";
import { isLive, statusChip } from "./status.js";

const TABS = [
  ["live", "Live", liveView, isLive],
  ["plots", "Plots", exploreView, () => true],
  ["calibration", "Calibration", calibrationView, (one) => one.has.calibration],
  ["diagnosis", "Diagnosis", diagnosisView, (one) => one.has.diagnosis],
  ["acceptance", "Acceptance", acceptanceView, (one) => one.has.acceptance],
  ["events", "Events", eventsView, () => true],
  ["about", "About", aboutView, () => true],
];

/** The view of `#/campaigns/ID/PAGE`. */
export async function campaignView(root, { parts: [id, page], query, signal }) {
  const campaign = await get(campaignPath(id), {}, signal);
  const tabs = TABS.filter(([, , , there]) => campaign.status !== "unreadable" && there(campaign));
  const [name, , view] = tabs.find(([tab]) => tab === page) ?? tabs[0] ?? ["", "", null];
  document.title = `${campaign.name} – benchctl`;
  const body = el("div", { class: `page ${name}` });
  fill(
    root,
    el(
      "div",
      { class: "title" },
      el("h1", {}, campaign.name),
      statusChip(campaign.status),
      el("p", { class: "subtitle" }, inOneLine(campaign)),
    ),
    el(
      "nav",
      { class: "tabs", "aria-label": "pages of this campaign" },
      tabs.map(([tab, title]) =>
        el("a", { href: link(["campaigns", id, tab]), "aria-current": tab === name ? "page" : null }, title),
      ),
      el("a", { href: link(["compare"], { a: id }) }, "Compare …"),
    ),
    campaign.altered &&
      el(
        "div",
        { class: "banner bad", role: "alert" },
        el("p", {}, el("b", {}, "Altered. "), campaign.altered),
        el("p", {}, "Do not use this copy. Take the campaign from where it was copied."),
      ),
    body,
  );
  tabs.forEach(([tab, title], index) =>
    onKeys([String(index + 1)], `page: ${title}`, () => go(["campaigns", id, tab]), signal),
  );
  if (view) await view(body, { campaign, query, signal });
  else
    fill(
      body,
      el("p", { class: "nothing" }, campaign.says),
      el("p", {}, "What can be done: benchctl verify, benchctl recover."),
    );
}

/** The view of provenance and notes. */
function aboutView(body, { campaign }) {
  fill(
    body,
    campaign.notes.length > 0 &&
      el(
        "ul",
        {},
        campaign.notes.map((note) => el("li", {}, note)),
      ),
    el(
      "dl",
      { class: "facts" },
      fact("Digest", campaign.digest && el("code", {}, campaign.digest)),
      fact("Manifest", isLive(campaign) ? "" : campaign.integrity),
      fact("Bench", campaign.bench),
      fact("Operator", campaign.operator),
      Object.entries(campaign.provenance).map(([name, value]) => fact(name.replaceAll("_", " "), value)),
    ),
    el("h2", {}, "Limits of the bench"),
    el(
      "ul",
      {},
      campaign.limits.map(({ quantity, unit, low, high }) =>
        el("li", {}, `${quantity}: ${low ?? "…"} to ${high ?? "…"} ${unit}`),
      ),
    ),
  );
}

function inOneLine(campaign) {
  const told = [campaign.unit && `unit ${campaign.unit}`, campaign.model, campaign.procedure]
    .filter(Boolean)
    .join(" · ");
  const whole = count(campaign.steps_whole);
  const steps = campaign.steps_planned ? `${whole} of ${count(campaign.steps_planned)} steps complete` : `${whole} steps`;
  const much = ` · ${steps} · ${count(campaign.samples)} samples · ${duration(campaign.duration_s)}`;
  return [told, " · ", moment(campaign.started_utc), campaign.status !== "running" && much];
}
