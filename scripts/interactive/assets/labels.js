// Names for what Dash gives no way to name: the file input, and the list of logs while it is empty.
function name_parts() {
  const names = [["#upload input", "Choose log files"], ["#log", "Log to look at"],
                 ["#plant", "Plant to drive on"], ["#beside", "Model to show beside"]];
  for (const [selector, name] of names)
    for (const part of document.querySelectorAll(selector))
      if (part.getAttribute("aria-label") !== name) part.setAttribute("aria-label", name);
  for (const part of document.querySelectorAll("#upload input")) part.removeAttribute("autocomplete");
}
// On a phone what a button leads to stands below the buttons.
document.addEventListener("click", event => {
  const button = event.target.closest("aside button[id*='\"do\"']");
  if (button && window.innerWidth < 740) document.querySelector("main").scrollIntoView();
});
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
