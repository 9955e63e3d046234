// What a page does beside showing itself. Everything can be read without it.
document.addEventListener("DOMContentLoaded", () => {
  filterLedger();
  readableExcerpts();
  openPanel();
  placeNotes();
  breakNames();
  nameKinds();
  switchCode();
  foldParts();
  markLaboratories();
  showEntry();
  fitFormulas();
  window.addEventListener("hashchange", openPanel);
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
  for (const verdict of document.querySelectorAll("article p > .verdict")) {
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

/** The sidebar opens on the part of this page; the others are folded, so that all of them fit one screen. */
function foldParts() {
  for (const caption of document.querySelectorAll(".bd-sidebar-primary .bd-links p.caption")) {
    const pages = caption.nextElementSibling;
    const part = document.createElement("details");
    const heading = part.appendChild(document.createElement("summary"));
    part.open = pages.querySelector(".current") !== null;
    caption.replaceWith(part);
    heading.append(caption);
    part.append(pages);
  }
}

/** The entry of this page is in view, wherever the sidebar was scrolled to on the last one. */
function showEntry() {
  const sidebar = document.querySelector(".bd-sidebar-primary");
  const entry = sidebar?.querySelector("li.current.active > a");
  if (!entry) return;
  window.addEventListener("load", () => { // the theme scrolls before
    const [box, frame] = [entry, sidebar].map((each) => each.getBoundingClientRect());
    if (box.top < frame.top || box.bottom > frame.bottom) sidebar.scrollTop += box.top - frame.top - frame.height / 2;
  });
}

/** On a phone a formula is as large as those in the text, or as wide as the page. */
function fitFormulas() {
  const narrow = window.matchMedia("(max-width: 700px)");
  const sizes = new Map(); // as MathJax sets them
  function fit() {
    const formulas = [...document.querySelectorAll("article div.math > mjx-container[display]")];
    if (!narrow.matches && !formulas.some((each) => each.classList.contains("fitted"))) return;
    for (const each of formulas) {
      if (!sizes.has(each)) sizes.set(each, each.style.fontSize);
      each.style.fontSize = sizes.get(each);
    }
    const shown = formulas.map((each) => narrow.matches && each.clientWidth > 0); // it may be folded away
    formulas.forEach((each, i) => each.classList.toggle("fitted", shown[i]));
    const shares = formulas.map((each, i) => (shown[i] ? each.clientWidth / each.scrollWidth : 1));
    formulas.forEach((each, i) => {
      if (shares[i] < 1) each.style.fontSize = `${0.99 * shares[i] * parseFloat(sizes.get(each))}%`;
    });
  }
  window.MathJax?.startup?.promise?.then(fit);
  window.addEventListener("resize", fit);
  document.addEventListener("toggle", fit, true);
  document.addEventListener("change", fit); // another tab
}

/** An entry of the sidebar says that its page has a laboratory. */
function markLaboratories() {
  const root = document.documentElement.dataset.content_root;
  const addresses = new Set(LABORATORIES.map((page) => new URL(`${root}${page}.html`, location).pathname));
  for (const link of document.querySelectorAll(".bd-sidebar-primary li > a")) {
    if (!addresses.has(link.pathname)) continue;
    const words = link.lastChild.textContent.trimEnd();
    const [last, mark] = [document.createElement("span"), document.createElement("span")];
    last.className = "last-word"; // which takes the mark along to the next line
    last.append(words.slice(words.lastIndexOf(" ") + 1), "\u00a0", mark);
    link.lastChild.textContent = words.slice(0, words.lastIndexOf(" ") + 1);
    link.append(last);
    mark.className = "has-laboratory";
    mark.title = "has a laboratory";
    mark.role = "img";
    mark.ariaLabel = mark.title;
  }
}

/** What stands behind the # of the address; nothing if that is damaged. */
function anchored() {
  try {
    return decodeURIComponent(location.hash.slice(1));
  } catch {
    return "";
  }
}

/** A link to a panel behind a tab, or to a figure in one, opens that tab. */
function openPanel() {
  const target = document.getElementById(anchored());
  const label = target?.closest(".sd-tab-label") ?? target?.closest(".sd-tab-content")?.previousElementSibling;
  if (!label) return;
  label.click();
  target.scrollIntoView();
}

// On paper nothing can be opened: answers and numbers are, code stays folded. Paper is white in the dark, too.
const opened = new Set();
let screenTheme = "";
window.addEventListener("beforeprint", () => {
  screenTheme = document.documentElement.dataset.theme;
  document.documentElement.dataset.theme = "light";
  for (const details of document.querySelectorAll("article details:not(.hide, [open])")) {
    details.open = true;
    opened.add(details);
  }
});
window.addEventListener("afterprint", () => {
  document.documentElement.dataset.theme = screenTheme;
  opened.forEach((details) => (details.open = false));
  opened.clear();
});

/** Above the ledger: two lists to choose from and a field to search in. The address keeps them, "#ledger?verdict=...". */
function filterLedger() {
  const rows = [...document.querySelectorAll(".ledger-row")];
  if (!rows.length) return;
  const form = document.createElement("form");
  form.className = "ledger-filter";
  form.setAttribute("role", "search");
  form.setAttribute("aria-label", "Claims shown");
  const labelled = (name, field) => {
    const label = form.appendChild(document.createElement("label"));
    label.textContent = name[0].toUpperCase() + name.slice(1);
    field.name = name;
    return label.appendChild(field);
  };
  const lists = Object.fromEntries(["verdict", "chapter"].map((name) => {
    const list = labelled(name, document.createElement("select"));
    list.add(new Option("all", ""));
    new Set(rows.map((row) => row.dataset[name])).forEach((value) => list.add(new Option(value)));
    return [name, list];
  }));
  const words = labelled("search", document.createElement("input"));
  words.type = "search";
  const count = form.appendChild(document.createElement("output"));
  document.getElementById("ledger").before(form);

  function show() {
    const sought = words.value.trim().toLowerCase();
    const visible = rows.filter((row) => {
      const chosen = Object.entries(lists).every(([name, list]) => !list.value || list.value === row.dataset[name]);
      row.hidden = !chosen || !row.textContent.toLowerCase().includes(sought);
      return !row.hidden;
    });
    count.textContent = `${visible.length} of ${rows.length} claims`;
  }
  function keep() {
    show();
    const state = new URLSearchParams([...new FormData(form)].filter(([, value]) => value)).toString();
    try {
      history.replaceState(history.state, "", `#ledger${state ? `?${state}` : ""}`);
    } catch {
      /* a browser that allows no history for files: the choice is then not in the address */
    }
  }
  /** What the address says: a choice, or a claim, which is shown whatever was chosen. */
  function read() {
    const [id, state] = anchored().split("?");
    if (id === "ledger") {
      const chosen = new URLSearchParams(state);
      for (const field of [...Object.values(lists), words]) field.value = chosen.get(field.name) ?? "";
      if (state) form.scrollIntoView();
    }
    const row = rows.find((each) => each.id === id);
    if (row?.hidden) form.reset();
    show();
    if (!row) return;
    row.open = true;
    row.scrollIntoView();
  }
  form.addEventListener("input", keep);
  form.addEventListener("submit", (event) => event.preventDefault());
  window.addEventListener("hashchange", read);
  window.addEventListener("pageshow", read); // after the browser has put back an earlier choice
  read();
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
