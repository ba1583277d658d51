// The page begins here: the bar at the top, the session, and which view an address stands for.

import { ApiError } from "./api.js";
import { hide, watchConnection } from "./banners.js";
import { campaignView } from "./campaign.js";
import { compareView } from "./compare.js";
import { connection } from "./connection.js";
import { el, fill } from "./dom.js";
import { helpView } from "./help.js";
import { historyView } from "./history.js";
import { beginKeys, onKeys, showKeys } from "./keys.js";
import { listView } from "./list.js";
import { follow, go, link } from "./router.js";
import { begin, forget, isTokenInAddress, logOut, loginForm, refusal, session, takeToken } from "./session.js";
import { startView } from "./start.js";
import { beginTheme, isDark, theme, toggleTheme } from "./theme.js";

const VIEWS = {
  "": listView,
  campaigns: campaignView,
  start: startView,
  compare: compareView,
  history: historyView,
  help: helpView,
};
const PLACES = [
  ["Campaigns", []],
  ["Start", ["start"]],
  ["History", ["history"]],
  ["Compare", ["compare"]],
  ["Help", ["help"]],
];

const main = document.getElementById("main");
const render = follow(showView);

async function showView({ parts, query }, signal) {
  if (isTokenInAddress()) return void enter(takeToken());
  if (!session.role) return;
  drawTop(parts[0] ?? "");
  document.title = "benchctl";
  for (const key of ["run", "stop"]) hide(key);
  const view = VIEWS[parts[0] ?? ""] ?? listView;
  fill(main, el("p", { class: "nothing reading" }, "Reading …"));
  try {
    await view(main, { parts: parts.slice(1), query, signal });
  } catch (error) {
    if (signal.aborted) return;
    if (!(error instanceof ApiError)) throw error;
    if (error.status === 0) connection.addEventListener("back", render, { once: true, signal });
    fill(
      main,
      el("p", { class: "nothing" }, error.status === 0 ? "Waiting for the server." : error.message),
      el("p", {}, el("a", { href: link([]) }, "All campaigns")),
    );
  }
}

function drawTop(place) {
  const themeButton = el(
    "button",
    { type: "button", onclick: toggleTheme, "aria-label": "dark or light" },
    isDark() ? "Light" : "Dark",
  );
  theme.addEventListener("change", () => fill(themeButton, isDark() ? "Light" : "Dark"));
  const nav = PLACES.filter(([, [place]]) => place !== "start" || session.mayStart).map(([name, parts]) =>
    el("a", { href: link(parts), "aria-current": (parts[0] ?? "") === place ? "page" : null }, name),
  );
  fill(
    document.getElementById("top"),
    el("a", { class: "brand", href: link([]) }, "benchctl"),
    session.role && el("nav", { "aria-label": "pages" }, nav),
    el("span", { class: "gap" }),
    session.role && el("span", { class: "role" }, roleName()),
    el("button", { type: "button", onclick: showKeys, "aria-label": "keys" }, "?"),
    themeButton,
    session.role && el("button", { type: "button", onclick: leave }, "Log out"),
  );
}

function roleName() {
  if (!session.mayOperate) return "looks only";
  const runs = session.mayStart ? "may start and stop runs" : "may stop runs";
  return session.maySign ? `${runs}, and sign` : runs;
}

async function leave() {
  await logOut();
  go([]);
  askWho("");
}

function askWho(says) {
  render();
  drawTop("");
  loginForm(main, says, render);
}

async function enter(token) {
  try {
    await begin(token);
    if (session.role) render();
    else askWho("");
  } catch (error) {
    const why = refusal(error);
    if (error.status === 0) {
      fill(main, el("p", { class: "nothing" }, "Waiting for the server."));
      connection.addEventListener("back", () => enter(token), { once: true });
    } else {
      forget();
      askWho(token ? why : "");
    }
  }
}

function start() {
  beginTheme();
  beginKeys();
  watchConnection();
  onKeys(["Escape"], "back to the campaigns", () => go([]));
  document.getElementById("skip").addEventListener("click", () => main.focus());
  drawTop("");
  connection.addEventListener("stranger", () => {
    if (!session.role) return;
    forget();
    askWho("The session is over: it ends by itself after a while, and when the server starts anew.");
  });
  enter(takeToken());
}

start();
