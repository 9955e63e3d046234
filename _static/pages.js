// What a page does beside showing itself. Everything can be read without it.
document.addEventListener("DOMContentLoaded", () => {
  filterLedger();
  readableExcerpts();
  openPanel();
  placeNotes();
  breakNames();
  nameKinds();
  switchCode();
  window.addEventListener("hashchange", openPanel);
  window.addEventListener("load", showEntry); // after the theme has put the sidebar where it was on another page
});

/** A note of the margin begins level with what it is about. On a phone, where it stands between the paragraphs, it
    follows that: the paragraph or formula, and the formulas that end its sentence. */
function placeNotes() {
  const narrow = window.matchMedia("(max-width: 700px)");
  function next(element) {
    const following = element.nextElementSibling;
    return following?.matches("aside.margin") ? next(following) : following;
  }
  const notes = [...document.querySelectorAll("aside.margin.sidebar")].reverse().map((note) => {
    const place = new Comment("a note of the margin");
    note.before(place);
    let subject = next(note);
    while (subject?.matches("p, ul, ol, div.math") && next(subject)?.matches("div.math")) subject = next(subject);
    return [note, place, subject?.matches("p, ul, ol, div.math") ? subject : place];
  });
  const put = () => notes.forEach(([note, place, subject]) => (narrow.matches ? subject : place).after(note));
  narrow.addEventListener("change", put);
  put();
}

/** A long name of code in a table breaks after an underscore, a slash or a colon, and not within a word. */
function breakNames() {
  for (const name of document.querySelectorAll("article td code .pre")) {
    const parts = name.textContent.split(/(?<=_|\/|::)(?=\w)/);
    if (parts.length > 1) name.replaceChildren(...parts.flatMap((part) => [part, document.createElement("wbr")]));
  }
}

/** What the styles of a phone must know and no selector says: cells without a number, counts that stay with their
    verdict, and outputs that are prose. */
function nameKinds() {
  for (const cell of document.querySelectorAll(".methods td")) {
    cell.classList.toggle("absent", cell.textContent.trim() === "–");
  }
  for (const verdict of document.querySelectorAll(".chapter-box .verdict")) {
    const count = verdict.previousSibling;
    if (count) count.textContent = count.textContent.replace(/ $/, "\u00a0"); // no line ends between "2" and its verdict
  }
  for (const output of document.querySelectorAll("article .cell_output pre")) {
    output.classList.toggle("prose", !/\S {2,}\S/.test(output.textContent)); // two spaces align columns
  }
}

/** A button at the top opens all code of a page, also that which shows nothing, and folds it again. */
function switchCode() {
  const folds = [...document.querySelectorAll("article div.cell details.hide")];
  const buttons = document.querySelector(".article-header-buttons");
  if (!folds.length || !buttons) return;
  const button = document.createElement("button");
  button.className = "btn btn-sm code-switch";
  button.type = "button";
  button.textContent = "</>";
  button.title = "Show all code of this page";
  button.ariaLabel = button.title;
  button.ariaPressed = "false";
  button.addEventListener("click", () => {
    const shown = document.documentElement.classList.toggle("with-code");
    button.ariaPressed = String(shown);
    for (const fold of folds) fold.open = shown;
  });
  buttons.prepend(button);
}

/** The sidebar shows the page's own entry. */
function showEntry() {
  const sidebar = document.querySelector(".bd-sidebar-primary");
  const entry = sidebar?.querySelector("li.current.active > a")?.getBoundingClientRect();
  if (!entry) return;
  const frame = sidebar.getBoundingClientRect();
  if (entry.top < frame.top || entry.bottom > frame.bottom) sidebar.scrollTop += entry.top - frame.top - frame.height / 3;
}

/** A link to a panel behind a tab, or to a figure in one, opens that tab. */
function openPanel() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const label = target?.closest(".sd-tab-label") ?? target?.closest(".sd-tab-content")?.previousElementSibling;
  if (!label) return;
  label.click();
  target.scrollIntoView();
}

// On paper nothing can be opened: answers and numbers are, code stays folded.
const opened = new Set();
window.addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("article details:not(.hide, [open])")) {
    details.open = true;
    opened.add(details);
  }
});
window.addEventListener("afterprint", () => {
  opened.forEach((details) => (details.open = false));
  opened.clear();
});

/** Above the table of claims: two lists to choose from. The address keeps the choice. */
function filterLedger() {
  const rows = [...document.querySelectorAll("article tbody tr")].filter((row) => row.querySelector("[id^='claim-']"));
  if (!rows.length) return;
  const properties = rows.map((row) => ({
    verdict: row.querySelector(".verdict").textContent.trim(),
    chapter: row.querySelector("td a").textContent.trim(),
  }));
  const form = document.createElement("form");
  form.className = "ledger-filter";
  form.setAttribute("role", "search");
  form.setAttribute("aria-label", "Claims shown");
  const lists = Object.fromEntries(["verdict", "chapter"].map((name) => {
    const label = form.appendChild(document.createElement("label"));
    label.textContent = name[0].toUpperCase() + name.slice(1);
    const list = label.appendChild(document.createElement("select"));
    list.name = name;
    list.add(new Option("all", ""));
    new Set(properties.map((each) => each[name])).forEach((value) => list.add(new Option(value)));
    return [name, list];
  }));
  const count = form.appendChild(document.createElement("output"));
  const table = rows[0].closest("table");
  const box = table.closest(".pst-scrollable-table-container") ?? table;
  box.before(form);

  function show() {
    let shown = 0;
    rows.forEach((row, number) => {
      row.hidden = Object.entries(lists).some(([name, list]) => list.value && list.value !== properties[number][name]);
      shown += !row.hidden;
    });
    count.textContent = `${shown} of ${rows.length} claims`;
  }
  /** A link to a row shows it, whatever was chosen. */
  function reveal() {
    const row = document.getElementById(decodeURIComponent(location.hash.slice(1)))?.closest("tr");
    if (!row?.hidden) return;
    form.reset();
    show();
    row.scrollIntoView();
  }
  form.addEventListener("change", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  window.addEventListener("hashchange", reveal);
  window.addEventListener("pageshow", show); // after the browser has put back an earlier choice
  show();
}

/** Excerpts of the search are taken from prose: without code, and without formulas that would be TeX there. */
function readableExcerpts() {
  if (typeof Search === "undefined") return;
  const whole = Search.htmlToText;
  Search.htmlToText = (html, anchor) => {
    const page = new DOMParser().parseFromString(html, "text/html");
    page.querySelectorAll(".cell_input, summary, div.math, .bd-header-article").forEach((element) => element.remove());
    for (const formula of page.querySelectorAll("span.math")) formula.textContent = plain(formula.textContent);
    return whole(page.documentElement.outerHTML, anchor).replace(/\s+/g, " ");
  };
}

/** A formula in a line of text: kept if it reads as text once its brackets are off, or else an ellipsis. */
function plain(tex) {
  const bare = tex.replace(/^\\\(|\\\)$/g, "").trim();
  return /^[\w\s=+−<>.,()-]*$/.test(bare) ? bare : "…";
}
