// Names for what Dash gives no way to name: the file input, and the list of logs while it is empty.
function name_parts() {
  const names = [["#upload input", "Choose log files"], ["#log", "Log to look at"],
                 ["#plant", "Plant to drive on"], ["#beside", "Model to compare with"]];
  for (const [selector, name] of names)
    for (const part of document.querySelectorAll(selector))
      if (part.getAttribute("aria-label") !== name) part.setAttribute("aria-label", name);
  for (const part of document.querySelectorAll("#upload input")) part.removeAttribute("autocomplete");
}
// What a button leads to stands on top of the results: below the buttons on a phone, and above what
// is read further down.
document.addEventListener("click", event => {
  const button = event.target.closest("button[id*='\"do\"']"), main = document.querySelector("main");
  if (!button || !main) return;
  if (window.innerWidth < 740 || main.getBoundingClientRect().top < 0) main.scrollIntoView();
});
// On a phone, the parts that are needed last are folded, so that results are nearer; on a low screen,
// so that the name of each part is seen.
let folded = false;
function fold_what_has_no_room() {
  const parts = document.querySelectorAll("aside details.folding");
  if (folded || !parts.length) return;
  folded = true;
  const high = document.querySelector("aside").scrollHeight > window.innerHeight;
  if (window.innerWidth < 740 || high) for (const part of parts) part.open = false;
}
// Charts are first drawn while they are hidden, where texts have no size: legends of two lines are
// placed as if they had one, until something of them changes.
const placed = new WeakSet();
function place_legends() {
  for (const chart of document.querySelectorAll(".js-plotly-plot")) {
    if (placed.has(chart) || !chart.offsetHeight || !chart.layout || !chart.layout.legend) continue;
    placed.add(chart);
    setTimeout(() => window.Plotly.relayout(chart, {"legend.x": 0}), 300);
  }
}
new MutationObserver(place_legends).observe(document.documentElement, { childList: true, subtree: true });
new MutationObserver(name_parts).observe(document.documentElement, { childList: true, subtree: true });
new MutationObserver(fold_what_has_no_room).observe(document.documentElement, { childList: true, subtree: true });
