// All campaigns: those that run on top, the others newest first, with a search and a choice of two to compare.

import { get, repeat } from "./api.js";
import { el, fill, say } from "./dom.js";
import { count, duration, moment } from "./format.js";
import { onKeys } from "./keys.js";
import { QueuePanel } from "./queue.js";
import { go, link } from "./router.js";
import { alteredChip, isLive, statusChip } from "./status.js";

const AGAIN_MS = 3000;
const DOCUMENTS = [
  ["calibration", "calibrated"],
  ["diagnosis", "diagnosed"],
  ["acceptance", "accepted"],
];

/** The view of `#/`. */
export async function listView(root, { query, signal }) {
  const search = el("input", {
    type: "search",
    id: "search",
    placeholder: "name, unit, procedure, operator, status",
    autocomplete: "off",
  });
  search.value = query.get("q") ?? "";
  const rows = el("ul", { class: "campaigns", "aria-label": "campaigns" });
  const tally = el("p", { class: "how", role: "status" });
  const compare = el(
    "button",
    { type: "button", class: "main", onclick: goCompare, hidden: true },
    "Compare these two",
  );
  const chosen = new Set();
  let campaigns = [];

  fill(
    root,
    el(
      "div",
      { class: "title" },
      el("h1", {}, "Campaigns"),
      el("span", { class: "gap" }),
      compare,
      el("label", { class: "search", for: "search" }, "Search ", search),
    ),
    new QueuePanel(signal).root,
    tally,
    rows,
  );

  function draw() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = campaigns.filter((one) => words.every((word) => searchable(one).includes(word)));
    const live = found.filter(isLive);
    const focused = document.activeElement?.closest(".campaigns > li")?.dataset.id;
    fill(
      rows,
      [...live, ...found.filter((one) => !isLive(one))].map((one) => row(one, chosen, choose)),
    );
    if (focused) rows.querySelector(`li[data-id="${CSS.escape(focused)}"] a`)?.focus();
    say(tally, toldOf(campaigns, found, live));
  }

  function choose(id, isChosen) {
    if (isChosen) chosen.add(id);
    else chosen.delete(id);
    compare.hidden = chosen.size !== 2;
  }

  function goCompare() {
    const [a, b] = chosen;
    go(["compare"], { a, b });
  }

  search.addEventListener("input", draw);
  search.addEventListener("keydown", (event) => event.key === "Enter" && rows.querySelector("a")?.focus());
  bindKeys(rows, search, signal);
  campaigns = (await get("/api/campaigns", {}, signal)).campaigns;
  draw();
  repeat(async () => {
    const fresh = (await get("/api/campaigns", {}, signal)).campaigns;
    if (JSON.stringify(fresh) === JSON.stringify(campaigns)) return;
    campaigns = fresh;
    draw();
  }, AGAIN_MS, signal);
}

function row(one, chosen, choose) {
  const pick = el("input", {
    type: "checkbox",
    "aria-label": `compare ${one.name}`,
    onchange: (event) => choose(one.id, event.target.checked),
  });
  pick.checked = chosen.has(one.id);
  const what = el("b", {}, one.name);
  const made = el("small", {}, [one.procedure, one.bench].filter(Boolean).join(" · "));
  return el(
    "li",
    { "data-id": one.id, class: isLive(one) ? "live" : null },
    el("label", { class: "pick" }, pick),
    el(
      "a",
      { href: link(["campaigns", one.id]) },
      el("span", { class: "what" }, what, made),
      el(
        "span",
        { class: "state" },
        statusChip(one.status),
        one.altered && alteredChip(),
        one.status === "running" && progress(one),
      ),
      one.status === "unreadable" ? el("span", { class: "says" }, one.says) : columns(one),
    ),
  );
}

function progress({ steps_whole, steps_planned }) {
  return el("progress", { max: 1, value: steps_planned ? steps_whole / steps_planned : 0, "aria-label": "steps done" });
}

function columns(one) {
  const has = DOCUMENTS.filter(([kind]) => one.has[kind]).map(([, word]) => el("span", { class: "tag" }, word));
  const whole = count(one.steps_whole);
  const steps = one.steps_planned ? `${whole} of ${count(one.steps_planned)} steps` : `${whole} steps`;
  const much = `${count(one.samples)} samples, ${duration(one.duration_s)}`;
  return [
    el("span", {}, el("b", {}, one.unit), el("small", {}, one.model)),
    el("span", {}, moment(one.started_utc), el("small", {}, one.operator)),
    el("span", {}, steps, el("small", {}, much)),
    el("span", { class: "has" }, has, el("small", {}, one.altered || one.says)),
  ];
}

function bindKeys(rows, search, signal) {
  const move = (by) => {
    const links = [...rows.querySelectorAll("a")];
    const here = links.indexOf(document.activeElement);
    links[Math.min(links.length - 1, Math.max(0, here + by))]?.focus();
  };
  onKeys(["/"], "search", () => search.select(), signal);
  onKeys(["Enter"], "open the campaign", () => {}, signal);
  onKeys(["ArrowDown", "j"], "the next campaign", () => move(1), signal);
  onKeys(["ArrowUp", "k"], "the campaign before", () => move(-1), signal);
}

function searchable(one) {
  return [one.name, one.unit, one.model, one.procedure, one.operator, one.bench, one.status].join(" ").toLowerCase();
}

function toldOf(all, found, live) {
  if (!all.length) return "No campaign is here yet. Run one: benchctl run two_stage --bench simulated";
  const total = `${count(all.length)} ${all.length === 1 ? "campaign" : "campaigns"}`;
  if (!found.length)
    return `None of ${total} has this. Search for a part of its name, unit, procedure or status.`;
  const told = found.length === all.length ? total : `${count(found.length)} of ${total}`;
  return live.length ? `${told}, ${live.length} not finished` : told;
}
