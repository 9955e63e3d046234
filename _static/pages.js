// What a page does beside showing itself. Everything can be read without it.
document.addEventListener("readystatechange", () => { // before the theme looks for what stands in the margin
  const change = (selector, how) => document.querySelectorAll(selector).forEach(how);
  change("summary, .search-button, .search-button-field", (each) => each.removeAttribute("aria-label")); // they have texts
  change(".measured-scroll", (each) => (each.tabIndex = 0)); // to scroll by keys
  change("article code .pre", (each) => (each.innerHTML = each.innerHTML.replace(BREAKS, "$1<wbr>")));
  change("article :is(p, li, td, figcaption, .doc, .caption-text, .ledger-row *)", (each) => each.childNodes.forEach(hold));
  change("article img[style*=height]", ({ style }) => (style.aspectRatio = parseFloat(style.width) / parseFloat(style.height)));
  change("article figure > img:not([style*=height])", (each) => (each.loading = "eager"));
  const part = document.querySelector(".bd-links ul:has(> .current)")?.previousElementSibling; // its heading
  sessionStorage.setItem("sidebar-scroll-top", part ? part.getBoundingClientRect().top - 0.3 * innerHeight : 0);
  change("nav.page-toc a", (each) => (each.onclick = () => void (document.getElementById("pst-secondary-sidebar-checkbox").checked = false)));
  if (innerWidth >= 1200) captionsAside();
  if (typeof Search !== "undefined") Search.htmlToText = prose;
  const rows = [...document.querySelectorAll(".ledger-row")];
  if (!rows.length) return;
  for (const link of document.querySelectorAll(".ledger-chapter > p > a")) { // by its title, as the sidebar has it
    const page = document.querySelector(`.bd-links a[href="${link.getAttribute("href")}"]`);
    if (page) link.textContent = page.textContent;
  }
  filterLedger(rows);
  openClaim(rows);
  window.addEventListener("hashchange", () => openClaim(rows));
}, { once: true });

// Spaces at which no line ends: before units and numbers of things, and after the number of a page.
const hold = (node) => node.nodeType === Node.TEXT_NODE && (node.data = node.data.replace(HELD, "\u00a0"));
const HELD = /(?<=\d) (?=(?:\d{3}\b|m|s|cm|mm|ms|µs|Hz|dB|°|%|kB|MB|GB|rad|targets|runs)(?![\wµ]))|(?<=\b(?:sensors?|sequence|scene|page|chapter)) (?=[A-Z]\b|\d)|(?<=^\w\d?[ \u00a0]·) /g;
// Where a name may break: after a dot, an underscore, a bracket or a sign between its parts; not in a number or an option.
const BREAKS = /([a-z)\]][._=,(/])(?=[\w"-])/gi;
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false; // a folder's pages cannot be read

// The search's: chapters and guides come before the appendix, functions and the gallery last; words in a title count.
const WEIGHTS = [
  [/^chapters\/[a-z]_/, 3],
  [/^intro|^chapters\/(?!gallery)/, 12],
  [/./, -4],
];
const query = new URLSearchParams(location.search).get("q") ?? "";
const inTitle = (title) => query.toLowerCase().match(/\w{3,}/g)?.filter((word) => title.toLowerCase().includes(word)).length ?? 0;
var Scorer = {
  score: ([page, title, , , score]) => score + WEIGHTS.find(([pages]) => pages.test(page))[1] + 4 * inTitle(title)
    + (/[A-Z_]/.test(query.slice(1)) && title.split(".").includes(query) ? 40 : 0), // a name of the code
  objNameMatch: 11,
  objPartialMatch: 2,
  objPrio: { 0: 5, 1: 2, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};

/** What a search's excerpt is taken from: a page's text, or a section's, without code and tables. */
function prose(page, anchor) {
  const article = new DOMParser().parseFromString(page, "text/html").querySelector("article");
  article.querySelectorAll(".headerlink, .cell_input, details.hide, table, script, style").forEach((each) => each.remove());
  return ((anchor && article.querySelector(anchor)) || article).textContent.replace(/\s+/g, " ");
}

/** Captions in the margin, from the top of their figures; the page's contents fold away from what stands there. */
function captionsAside() {
  for (const caption of document.querySelectorAll("figure:has(> img) > figcaption")) {
    const wide = caption.parentNode.querySelector("img.page");
    if (!wide) caption.parentNode.prepend(caption);
    (wide ? caption.parentNode : caption).classList.add("popout");
  }
}

/** Above the ledger: a list of verdicts to choose from and a field to search in. */
function filterLedger(rows) {
  const form = document.createElement("form");
  Object.assign(form, { className: "ledger-filter", role: "search", ariaLabel: "Claims shown" });
  form.innerHTML = '<label>Verdict <select><option value="">all</option></select></label>'
    + '<label>Search <input type="search"></label><output></output>';
  const [verdict, words, count] = form.querySelectorAll("select, input, output");
  new Set(rows.map((row) => row.dataset.verdict)).forEach((value) => verdict.add(new Option(value)));
  function show() {
    for (const row of rows) {
      const chosen = !verdict.value || verdict.value === row.dataset.verdict;
      row.hidden = !chosen || !row.textContent.toLowerCase().includes(words.value.trim().toLowerCase());
    }
    count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} claims`;
  }
  for (const event of ["input", "change"]) form.addEventListener(event, show);
  form.addEventListener("reset", () => setTimeout(show));
  form.addEventListener("submit", (event) => event.preventDefault());
  document.getElementById("ledger").before(form);
  show();
}

/** The claim that the address names is shown whatever was chosen, and unfolded. */
function openClaim(rows) {
  const row = rows.find((each) => `#${each.id}` === location.hash);
  if (!row) return;
  if (row.hidden) document.querySelector(".ledger-filter").reset();
  row.hidden = false;
  row.open = true;
  row.scrollIntoView();
}
