// The handbook: its topics, one page of it, and the passages of all pages that have the words searched for.

import { get } from "./api.js";
import { el, fill } from "./dom.js";
import { onKeys } from "./keys.js";
import { link, note } from "./router.js";

const AROUND = 110;
let pages = null;

/** The view of `#/help`, `#/help/TOPIC` and `#/help/TOPIC/HEADING`. */
export async function helpView(root, { parts, query, signal }) {
  pages ??= (await get("/api/help", {}, signal)).pages;
  const page = pages.find(({ topic }) => topic === parts[0]);
  const search = el("input", { type: "search", id: "find-help", autocomplete: "off", placeholder: "words" });
  const body = el("div", { class: "help-body" });
  search.value = query.get("q") ?? "";

  function draw() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    fill(body, words.length ? passages(words) : page ? article(page) : [parts[0] && unknown(parts[0]), contents()]);
  }

  function searched() {
    note(["help", ...parts], { q: search.value });
    draw();
  }

  search.addEventListener("input", searched);
  search.addEventListener("keydown", (event) => event.key === "Enter" && body.querySelector("a")?.focus());
  onKeys(["/"], "search the handbook", () => search.select(), signal);
  document.title = `${page?.title ?? "Help"} – benchctl`;
  fill(
    root,
    el("div", { class: "title" }, el("label", { class: "search", for: "find-help" }, "Search the handbook ", search)),
    el("div", { class: "help" }, el("nav", { "aria-label": "topics" }, topics(page)), body),
  );
  draw();
  const heading = body.querySelector(`[data-anchor="${CSS.escape(parts[1] ?? "")}"]`);
  if (heading) heading.scrollIntoView();
  else scrollTo(0, 0);
}

function topics(shown) {
  const entry = (page) => [
    el("a", { href: link(["help", page.topic]), "aria-current": page === shown ? "page" : null }, page.title),
    page === shown &&
      page.sections
        .filter(({ level }) => level === 2)
        .map(({ anchor, heading }) => el("a", { class: "part", href: link(["help", page.topic, anchor]) }, heading)),
  ];
  return pages.map(entry);
}

function contents() {
  const entry = ({ topic, title, sections }) =>
    el("li", {}, el("a", { href: link(["help", topic]) }, title), nodes(sections[0].content.slice(0, 1)));
  return [el("h1", {}, "Handbook"), el("ul", { class: "contents" }, pages.map(entry))];
}

function unknown(topic) {
  return el("p", { class: "wrong" }, `There is no page ${topic} in the handbook. These are its pages:`);
}

function article({ topic, sections }) {
  return sections.map(({ anchor, level, heading, content }) => [
    el(`h${level}`, { "data-anchor": anchor }, el("a", { href: link(["help", topic, anchor]) }, heading)),
    nodes(content),
  ]);
}

function nodes(content) {
  return content.map((node) => {
    if (typeof node === "string") return node;
    const [tag, attributes, ...inner] = node;
    const made = el(tag, attributes, nodes(inner));
    if (tag === "pre") made.tabIndex = 0; // whoever uses keys scrolls it too
    return tag === "table" ? el("div", { class: "scrolls", tabindex: "0", role: "region" }, made) : made;
  });
}

function passages(words) {
  const has = (text) => words.filter((word) => text.toLowerCase().includes(word)).length;
  const found = pages
    .flatMap((page) => page.sections.map((section) => ({ page, section, text: `${page.title} › ${section.heading}` })))
    .map((one) => ({ ...one, body: el("div", {}, nodes(one.section.content)) }))
    .filter(({ text, body }) => has(`${text} ${body.textContent}`) === words.length)
    .sort((a, b) => has(b.section.heading) - has(a.section.heading));
  const entry = ({ page, section, text, body }) => {
    const blocks = [...body.querySelectorAll("p, li, tr, pre")].flatMap(lines);
    const best = blocks.reduce((one, other) => (has(other) > has(one) ? other : one), blocks[0] ?? "");
    const place = link(["help", page.topic, section.anchor]);
    return el("li", {}, el("a", { href: place }, marked(text, words)), el("p", {}, marked(cut(best, words), words)));
  };
  if (!found.length) return el("p", { class: "nothing", role: "status" }, "No passage has these words. Use fewer words.");
  const tally = found.length === 1 ? "1 passage" : `${found.length} passages`;
  return [el("p", { class: "how", role: "status" }, tally), el("ol", { class: "passages" }, found.map(entry))];
}

function lines(block) {
  return block.tagName === "PRE" ? block.textContent.split("\n") : [block.textContent];
}

function cut(text, words) {
  const places = words.map((word) => text.toLowerCase().indexOf(word)).filter((place) => place >= 0);
  const near = places.length ? Math.min(...places) - AROUND : 0;
  const from = near > 0 ? text.indexOf(" ", near) + 1 : 0;
  const to = from + 3 * AROUND;
  return `${from ? "… " : ""}${text.slice(from, to)}${to < text.length ? " …" : ""}`;
}

function marked(text, words) {
  const escaped = words.map((word) => word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
  return text
    .split(new RegExp(`(${escaped.join("|")})`, "i"))
    .map((part, index) => (index % 2 ? el("mark", {}, part) : part));
}
