// What the page knows by itself, also when nobody answers it: how long something runs, and whether
// the server is still there.
setInterval(() => {
  for (const part of document.querySelectorAll(".since"))
    part.dataset.shown = `${Math.max(0, Math.round(Date.now() / 1000 - part.dataset.since))} s`;
}, 500);

const ASK_EACH = 2000; // ms
const ASK_AGAIN = 300; // ms: one request that is lost is no server that has gone
const ANSWER_WITHIN = 8000; // ms: a server that draws a long log may need a while
let missed = 0, next = 0;

function say_gone(is_gone) {
  let note = document.querySelector(".gone");
  if (is_gone === (note !== null)) return;
  // Without a server each look at the project would leave an error in the browser's console.
  window.dash_clientside.set_props("tick", { disabled: is_gone });
  if (!is_gone) return note.remove();
  note = document.createElement("div");
  note.className = "gone";
  note.setAttribute("role", "alert");
  const command = document.createElement("code");
  command.textContent = document.querySelector("header").dataset.command;
  note.append("The workbench does not answer: it has ended. Nothing that was done is lost. Start it again, ",
              "and open the address that it prints: ", command);
  document.body.append(note);
}

async function ask() {
  clearTimeout(next);
  try {
    // Another run of the workbench on this port has another token: it refuses, and is not this one.
    const answer = await fetch("/alive", { signal: AbortSignal.timeout(ANSWER_WITHIN) });
    missed = answer.ok ? 0 : missed + 1;
  } catch { missed += 1; }
  if (document.querySelector("header[data-command]")) say_gone(missed >= 2);
  clearTimeout(next);
  next = setTimeout(ask, missed === 1 ? ASK_AGAIN : ASK_EACH);
}
next = setTimeout(ask, ASK_EACH);
// Whoever presses a button learns at once that nobody listens.
document.addEventListener("click", ask);
