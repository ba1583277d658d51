// What happened, in the order in which it happened: the journal in words.

import { campaignPath, get } from "./api.js";
import { el, fill, say } from "./dom.js";
import { count, moment } from "./format.js";

const MOST_SHOWN = 200;
const AT_ONCE = 500;
const LEVELS = { warning: "warning: ", bad: "fault: " };

/** Put new events on top of a list, of which the latest ones stay. */
export function appendEvents(list, events) {
  for (const event of events) list.prepend(item(event));
  while (list.children.length > MOST_SHOWN) list.lastChild.remove();
}

/** The view of a campaign's events: all of them, with a filter. */
export async function eventsView(body, { campaign, signal }) {
  const only = el("input", { type: "checkbox", id: "only-warnings", onchange: draw });
  const list = el("ol", { class: "events all", "aria-label": "events" });
  const more = el("button", { type: "button", onclick: load }, "Show more");
  const tally = el("p", { class: "how", role: "status" });
  let [events, next] = [[], 0];

  async function load() {
    const reply = await get(campaignPath(campaign.id, "/events"), { after: next }, signal);
    events = events.concat(reply.events);
    next = reply.next;
    more.hidden = reply.events.length < AT_ONCE;
    draw();
  }

  function draw() {
    const shown = only.checked ? events.filter(({ level }) => level !== "info") : events;
    fill(list, shown.map(item));
    say(tally, `${count(shown.length)} of ${count(events.length)} events${more.hidden ? "" : " so far"}`);
  }

  fill(body, el("label", { for: "only-warnings" }, only, " only warnings and faults"), tally, list, more);
  await load();
}

function item({ wall_time, says, level }) {
  return el(
    "li",
    { class: level },
    moment(wall_time, { withDate: false, withSeconds: true }),
    " ",
    LEVELS[level] && el("b", {}, LEVELS[level]),
    says,
  );
}
