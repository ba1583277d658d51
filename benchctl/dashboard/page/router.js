// The address bar: which view is shown is in the fragment, `#/campaigns/ID/plots?from=…`, so that links lead back.

function address() {
  const [path, query = ""] = location.hash.replace(/^#/, "").split("?");
  return { parts: path.split("/").filter(Boolean).map(decoded), query: new URLSearchParams(query) };
}

/** The address of a view. */
export function link(parts, query = {}) {
  const present = Object.entries(query).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const asked = new URLSearchParams(present).toString();
  return `#/${parts.map(encodeURIComponent).join("/")}${asked ? `?${asked}` : ""}`;
}

/** Go to a view. */
export function go(parts, query = {}) {
  location.hash = link(parts, query);
}

/** Note something in the address without going anywhere: the view that is there stays. */
export function note(parts, query) {
  history.replaceState(null, "", link(parts, query));
}

/** Show the view of every address, with a signal that aborts when it is left; returns what shows it anew. */
export function follow(show) {
  let leaving = new AbortController();
  function render() {
    leaving.abort();
    leaving = new AbortController();
    show(address(), leaving.signal);
  }
  addEventListener("hashchange", render);
  return render;
}

function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part; // somebody cut the address short
  }
}
