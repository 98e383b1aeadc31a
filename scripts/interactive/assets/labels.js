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
new MutationObserver(name_parts).observe(document.documentElement, { childList: true, subtree: true });
