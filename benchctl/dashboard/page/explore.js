// The plots of a campaign: its timeline, the channels that are chosen, and its steps to jump to.

import { campaignPath, get } from "./api.js";
import { el, fill } from "./dom.js";
import { unitName } from "./format.js";
import { note } from "./router.js";
import { stepsTable } from "./steps.js";
import { Timeline } from "./timeline.js";
import { Zoom } from "./zoom.js";

const FIRST = ["rate_dps", "gyro_v", "gyro_c", "air_c"];
const HEIGHTS = [360, 210, 124, 110];

/** The view of a campaign's plots; the window and the channels are kept in the address. */
export function exploreView(body, { campaign, query, signal }) {
  const known = new Map(campaign.channels.map((channel) => [channel.name, channel]));
  const asked = (query.get("channels") ?? "").split(",").filter((name) => known.has(name));
  const chosen = new Set(asked.length ? asked : FIRST.filter((name) => known.has(name)));
  if (!chosen.size && known.size) chosen.add(known.keys().next().value);
  const plan = el("section", { class: "plan", "aria-label": "timeline" });
  const plots = el("div", {});
  const steps = el("div", {});
  fill(body, plan, chips(campaign.channels, chosen, changed), plots, steps);
  if (!known.size) return void fill(body, el("p", { class: "nothing" }, "This recording holds no samples yet."));

  const spans = campaign.steps.map((step) => ({ ...step, label: step.name }));
  const timeline = spans.length ? new Timeline(plan, spans, { onChoose: (span) => choose(span), signal }) : null;
  const zoom = new Zoom(plots, {
    end_s: campaign.t_end_s,
    marks: campaign.steps,
    signal,
    moved,
    view: (channel, from_s, to_s, pixels, stop) =>
      get(campaignPath(campaign.id, "/series"), { channel, from_s, to_s, pixels }, stop),
  });
  fill(steps, stepsTable(campaign.steps, choose));

  function choose(step) {
    const margin_s = 0.02 * (step.t_end_s - step.t_start_s);
    zoom.go(step.t_start_s - margin_s, step.t_end_s + margin_s);
    plots.scrollIntoView({ block: "nearest" });
  }

  function moved(from_s, to_s) {
    timeline?.showWindow(from_s, to_s);
    note(["campaigns", campaign.id, "plots"], { from: from_s, to: to_s, channels: [...chosen].join(",") });
  }

  function changed() {
    zoom.draw(panelsOf(campaign.channels, chosen));
    moved(zoom.from_s, zoom.to_s);
  }

  const [from_s, to_s] = ["from", "to"].map((name) => Number.parseFloat(query.get(name)));
  if (to_s > from_s) zoom.go(from_s, to_s, { remember: false });
  zoom.draw(panelsOf(campaign.channels, chosen));
}

function panelsOf(channels, chosen) {
  const units = new Map();
  for (const channel of channels.filter(({ name }) => chosen.has(name))) {
    const unit = unitName(channel.unit);
    units.set(unit, [
      ...(units.get(unit) ?? []),
      { name: channel.name, label: channel.name, stepped: channel.name.includes("setpoint") },
    ]);
  }
  const height = HEIGHTS[Math.min(units.size, HEIGHTS.length) - 1];
  return [...units].map(([unit, of]) => ({ unit, channels: of, height }));
}

function chips(channels, chosen, changed) {
  return el(
    "fieldset",
    { class: "choice channels" },
    el("legend", {}, "Channels"),
    channels.map(({ name, unit, says }) => {
      const box = el("input", {
        type: "checkbox",
        id: `channel-${name}`,
        onchange: () => (toggle(chosen, name), changed()),
      });
      box.checked = chosen.has(name);
      return [
        box,
        el("label", { for: `channel-${name}`, title: [says, unitName(unit)].filter(Boolean).join(", ") }, name),
      ];
    }),
  );
}

function toggle(set, name) {
  if (!set.delete(name)) set.add(name);
}
