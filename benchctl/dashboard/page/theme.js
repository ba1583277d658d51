// Light or dark: as the system has it until somebody chooses, then as chosen; and the colours that plots draw with.

const KEPT = "benchctl-theme";

/** Tells `change` when colours change. */
export const theme = new EventTarget();

const probe = document.createElement("span");
const system = matchMedia("(prefers-color-scheme: dark)");

/** Take up the choice that was kept. */
export function beginTheme() {
  const kept = localStorage.getItem(KEPT);
  if (kept === "light" || kept === "dark") document.documentElement.dataset.theme = kept;
  probe.hidden = true;
  document.body.append(probe);
  system.addEventListener("change", () => theme.dispatchEvent(new Event("change")));
}

/** Whether it is dark just now. */
export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : system.matches;
}

/** The other one from now on. */
export function toggleTheme() {
  const chosen = isDark() ? "light" : "dark";
  document.documentElement.dataset.theme = chosen;
  localStorage.setItem(KEPT, chosen);
  theme.dispatchEvent(new Event("change"));
}

/** A colour of the style sheet as the canvas takes it, such as `--series-1`. */
export function colour(name) {
  probe.style.color = `var(${name})`;
  return getComputedStyle(probe).color;
}
