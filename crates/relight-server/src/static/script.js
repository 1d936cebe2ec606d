// What pages do beyond what they do without a script: sort and filter in place, compare by a slider, show how an upload and the
// scoring go. No page needs it.

document.documentElement.classList.add("scripted");

/** What a cell is sorted by: a number where it is one, except in names. */
const key = ({ cells }, column) => {
  const { tagName, dataset } = cells[column];
  const number = Number(dataset.value);
  return tagName === "TH" || Number.isNaN(number) ? dataset.value : number;
};

const compare = (a, b) => (a < b ? -1 : a > b ? 1 : 0);

/** Sorts rows by a column. Those that are equal stay as they were. */
const sort = (table, head, falls) => {
  const body = table.tBodies[0];
  const column = head.cellIndex;
  const rows = [...body.rows].filter((row) => row.dataset.text !== undefined);
  rows.sort((a, b) => (falls ? -1 : 1) * compare(key(a, column), key(b, column)));
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", falls ? "descending" : "ascending");
  body.append(...rows);
};

for (const table of document.querySelectorAll("table[data-sortable]")) {
  table.tHead.addEventListener("click", (event) => {
    const link = event.target.closest("a");
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    const head = link.closest("th");
    const now = head.getAttribute("aria-sort");
    const falls = now ? now === "ascending" : head.dataset.falls !== undefined;
    sort(table, head, falls);
    const address = new URL(link.href);
    address.searchParams.set("order", falls ? "desc" : "asc");
    history.replaceState(null, "", address);
  });
}

for (const input of document.querySelectorAll("input[data-filter]")) {
  const table = document.getElementById(input.dataset.filter);
  const filter = () => {
    const wanted = input.value.trim().toLowerCase();
    for (const row of table.querySelectorAll("tr[data-text]")) row.hidden = !row.dataset.text.includes(wanted);
  };
  // A page that the server has filtered lacks rows: Enter asks it for others.
  input.addEventListener("input", filter);
  filter();
}

for (const box of document.querySelectorAll("[data-compare]")) {
  const range = document.createElement("input");
  Object.assign(range, { type: "range", min: 0, max: 100, step: 1, value: 50 });
  range.setAttribute("aria-label", "How much of the photograph is shown, from the left");
  const knob = document.createElement("span");
  knob.className = "knob";
  knob.setAttribute("aria-hidden", "true");
  knob.textContent = "⇔";
  const show = () => {
    box.style.setProperty("--at", `${range.value}%`);
    range.setAttribute("aria-valuetext", `${range.value} % photograph`);
  };
  range.addEventListener("input", show);
  show();
  box.classList.add("live");
  box.append(knob, range);
}

for (const button of document.querySelectorAll("button[data-copy]")) {
  if (!navigator.clipboard) continue;
  button.hidden = false;
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(document.getElementById(button.dataset.copy).textContent.trim());
    button.textContent = "Copied";
  });
}

for (const form of document.querySelectorAll("form[data-upload]")) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const sending = form.querySelector(".sending");
    const [bar, text] = [sending.querySelector("progress"), sending.querySelector("p")];
    const button = form.querySelector("button");
    const request = new XMLHttpRequest();
    const begun = performance.now();
    const fail = (why) => {
      button.disabled = false;
      text.textContent = why;
    };
    request.upload.addEventListener("progress", ({ loaded, total }) => {
      bar.value = loaded / total;
      const speed = loaded / 1e3 / (performance.now() - begun);
      text.textContent = loaded === total ? "Sent; the server stores it." : `${(loaded / 1e6).toFixed(0)} of ${(total / 1e6).toFixed(0)} MB, ${speed.toFixed(1)} MB/s`;
    });
    request.addEventListener("load", () => {
      if (request.status < 400 && request.responseURL !== form.action) {
        location.assign(request.responseURL);
        return;
      }
      const page = new DOMParser().parseFromString(request.responseText, "text/html");
      fail(page.querySelector(".alert, main p")?.textContent ?? `The server answered ${request.status}.`);
    });
    request.addEventListener("error", () => fail("The connection broke. Try again."));
    request.open("POST", form.action);
    request.send(new FormData(form));
    sending.hidden = false;
    button.disabled = true;
    text.textContent = "Starting";
  });
}

/** Follows a submission until its state is final, then loads the page with its scores. */
const follow = async () => {
  const state = document.querySelector("[data-waiting]");
  if (!state) return;
  try {
    const answer = await fetch(location.href);
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    const next = page.querySelector("#state");
    if (answer.ok && next) {
      if (next.dataset.waiting === undefined) {
        location.reload();
        return;
      }
      state.replaceChildren(...next.childNodes);
    }
  } catch {
    // The server may be starting again.
  }
  setTimeout(follow, 1500);
};
setTimeout(follow, 1000);
