// Elements of the page. Data becomes text and attributes, never markup: nothing here or elsewhere parses HTML.

const SVG = "http://www.w3.org/2000/svg";

/** An HTML element: `on…` are listeners, true and false set and leave out attributes, children are texts or nodes. */
export function el(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** The same in SVG. */
export function svg(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

/** Put these children in the place of those that a node has. */
export function fill(node, ...children) {
  node.replaceChildren(...children.flat(Infinity).filter(present));
  return node;
}

/** Set a node's text only where it differs, so that nothing is announced or laid out twice. */
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** A term and its value for a list of facts; nothing where the value is empty. */
export function fact(term, value) {
  const empty = value === null || value === undefined || value === "";
  return empty ? [] : [el("dt", {}, term), el("dd", {}, value)];
}

/** A table: heads are texts or [text, class]; rows are lists of texts, nodes or [content, class]. */
export function table(caption, heads, rows, className = "") {
  const cell = (tag, content, extra = {}) =>
    Array.isArray(content) ? el(tag, { class: content[1], ...extra }, content[0]) : el(tag, extra, content);
  const shown = el(
    "table",
    { class: className || null },
    caption && el("caption", {}, caption),
    el(
      "thead",
      {},
      el(
        "tr",
        {},
        heads.map((head) => cell("th", head, { scope: "col" })),
      ),
    ),
    el(
      "tbody",
      {},
      rows.map((row) =>
        el(
          "tr",
          {},
          row.map((content, index) => (index === 0 ? cell("th", content, { scope: "row" }) : cell("td", content))),
        ),
      ),
    ),
  );
  return el("div", { class: "scrolls", tabindex: "0", role: "region", "aria-label": caption || "table" }, shown);
}

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  node.append(...children.flat(Infinity).filter(present));
  return node;
}

function present(child) {
  return child !== null && child !== undefined && child !== false && child !== "";
}
