// Two campaigns side by side: one channel of both over the same time, and where their steps differ.

import { campaignPath, get } from "./api.js";
import { el, fill, table } from "./dom.js";
import { count, duration, number, unitName } from "./format.js";
import { link, go } from "./router.js";
import { statusChip } from "./status.js";
import { motion } from "./steps.js";
import { kindName } from "./timeline.js";
import { Zoom } from "./zoom.js";

const NAMES = ["A", "B"];
const SAME_S = 1;

/** The view of `#/compare?a=ID&b=ID&channel=…&step=…`: aligned by time, or by the beginning of a step. */
export async function compareView(root, { query, signal }) {
  const { campaigns } = await get("/api/campaigns", {}, signal);
  const asked = Object.fromEntries(query);
  const ids = [asked.a, asked.b].filter((id) => campaigns.some((one) => one.id === id));
  const body = el("div", {});
  fill(
    root,
    el("div", { class: "title" }, el("h1", {}, "Two campaigns")),
    el(
      "div",
      { class: "pair" },
      ["a", "b"].map((key, index) =>
        chooser(
          `Campaign ${NAMES[index]}`,
          key,
          asked,
          campaigns
            .filter((one) => one.status !== "unreadable")
            .map((one) => [one.id, `${one.name} (${one.unit}, ${one.status})`]),
        ),
      ),
    ),
    body,
  );
  if (ids.length < 2)
    return void fill(body, el("p", { class: "nothing" }, "Choose two campaigns. Those of one procedure tell most."));
  const pair = await Promise.all(ids.map((id) => get(campaignPath(id), {}, signal)));
  if (!signal.aborted) compare(body, pair, asked, signal);
}

function compare(body, pair, asked, signal) {
  const channels = pair[0].channels.filter(({ name }) => pair[1].channels.some((other) => other.name === name));
  const channel =
    channels.find(({ name }) => name === asked.channel) ??
    channels.find(({ name }) => name === "gyro_v") ??
    channels[0];
  const together = alike(pair);
  const step = together.find(([a]) => String(a.index) === asked.step);
  const plots = el("div", {});
  fill(
    body,
    el("div", { class: "pair" }, pair.map(card)),
    channel &&
      el(
        "div",
        { class: "pair" },
        chooser(
          "Channel",
          "channel",
          { ...asked, channel: channel.name },
          channels.map(({ name, unit }) => [name, unit ? `${name} (${unitName(unit)})` : name]),
        ),
        chooser("Aligned by", "step", { ...asked, step: asked.step ?? "" }, [
          ["", "time: both from their beginning"],
          ...together.map(([a]) => [String(a.index), `step ${a.index}, ${a.name}: both from its beginning`]),
        ]),
      ),
    plots,
    differences(pair),
  );
  if (!channel) return void fill(plots, el("p", { class: "nothing" }, "They have no channel in common."));
  const shifts = step ? step.map((one) => one.t_start_s) : [0, 0];
  const end_s = step
    ? Math.max(...step.map((one) => one.t_end_s - one.t_start_s))
    : Math.max(...pair.map((one) => one.t_end_s));
  const zoom = new Zoom(plots, { end_s, signal, view: (of, ...rest) => shifted(of, channel.name, ...rest) });
  zoom.draw([
    {
      unit: unitName(channel.unit),
      title: [channel.name, unitName(channel.unit)].filter(Boolean).join(", "),
      height: 320,
      channels: pair.map((one, index) => ({
        name: NAMES[index],
        label: `${NAMES[index]}: ${one.name}`,
        alpha: index ? 0.65 : 1,
        of: { id: one.id, shift_s: shifts[index] },
      })),
    },
  ]);
}

async function shifted({ id, shift_s }, channel, from_s, to_s, pixels, signal) {
  const query = { channel, from_s: from_s + shift_s, to_s: to_s + shift_s, pixels };
  const series = await get(campaignPath(id, "/series"), query, signal);
  return { ...series, t_s: series.t_s.map((t_s) => t_s - shift_s) };
}

function chooser(title, key, asked, options) {
  const changed = (event) => go(["compare"], { ...asked, [key]: event.target.value });
  const select = el(
    "select",
    { id: `choose-${key}`, onchange: changed },
    !options.some(([value]) => value === (asked[key] ?? "")) && el("option", { value: "" }, "choose …"),
    options.map(([value, text]) => el("option", { value, selected: value === (asked[key] ?? "") }, text)),
  );
  return el("label", { for: `choose-${key}` }, title, " ", select);
}

function card(one, index) {
  return el(
    "p",
    { class: "card" },
    el("b", {}, `${NAMES[index]} `),
    el("a", { href: link(["campaigns", one.id]) }, one.name),
    " ",
    statusChip(one.status),
    el(
      "small",
      {},
      `unit ${one.unit} · ${one.procedure} · ${count(one.steps.length)} steps · `,
      `${count(one.samples)} samples · ${duration(one.t_end_s)}`,
    ),
  );
}

function alike([a, b]) {
  const second = new Map(b.steps.map((step) => [step.index, step]));
  return a.steps
    .filter((step) => second.get(step.index)?.name === step.name && second.get(step.index).kind === step.kind)
    .map((step) => [step, second.get(step.index)]);
}

function differences([a, b]) {
  const [first, second] = [a, b].map((one) => new Map(one.steps.map((step) => [step.index, step])));
  const indices = [...new Set([...first.keys(), ...second.keys()])].sort((one, other) => one - other);
  const rows = indices.flatMap((index) => stepDifferences(index, first.get(index), second.get(index)));
  const differing = new Set(rows.map(([index]) => index)).size;
  const told = `${count(indices.length - differing)} of ${count(indices.length)} steps are alike`;
  return el(
    "section",
    {},
    el("h2", {}, "Steps"),
    rows.length
      ? table(`${told}; what differs:`, ["Step", "What", "A", "B"], rows, "dense")
      : el("p", {}, `${told}: kind, motion, set point, duration to ${SAME_S} s, wholeness, gaps.`),
  );
}

function stepDifferences(index, a, b) {
  if (!a || !b) return [[String(index), `only in ${a ? "A" : "B"}`, a?.name ?? "", b?.name ?? ""]];
  const facts = [
    ["name", a.name, b.name],
    ["kind", kindName(a.kind), kindName(b.kind)],
    ["motion", motion(a), motion(b)],
    ["set point, °C", number(a.setpoint_c, 4), number(b.setpoint_c, 4)],
    ["use", a.role ?? "", b.role ?? ""],
    ["state", a.whole ? "whole" : "cut", b.whole ? "whole" : "cut"],
    ["gaps", count(a.gaps), count(b.gaps)],
  ];
  const lasts = [a, b].map((one) => one.t_end_s - one.t_start_s);
  if (Math.abs(lasts[0] - lasts[1]) > SAME_S) facts.push(["lasts", ...lasts.map(duration)]);
  return facts
    .filter(([, one, other]) => one !== other)
    .map(([what, one, other]) => [`${index} ${a.name}`, what, one || "–", other || "–"]);
}
