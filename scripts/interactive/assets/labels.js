// Names for what Dash gives no way to name: the file input, and the list of logs while it is empty.
function name_parts() {
  const names = [["#upload input", "Choose log files"], ["#log", "Log to look at"]];
  for (const [selector, name] of names)
    for (const part of document.querySelectorAll(selector))
      if (part.getAttribute("aria-label") !== name) part.setAttribute("aria-label", name);
  for (const part of document.querySelectorAll("#upload input")) part.removeAttribute("autocomplete");
}
new MutationObserver(name_parts).observe(document.documentElement, { childList: true, subtree: true });
