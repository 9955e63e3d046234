// What a page does beside showing itself. Everything can be read without it.
document.addEventListener("DOMContentLoaded", () => {
  const rows = [...document.querySelectorAll(".ledger-row")];
  if (!rows.length) return;
  filterLedger(rows);
  openClaim(rows);
  window.addEventListener("hashchange", () => openClaim(rows));
});

/** Above the ledger: a list of verdicts to choose from and a field to search in. */
function filterLedger(rows) {
  const form = document.createElement("form");
  form.className = "ledger-filter";
  form.role = "search";
  form.ariaLabel = "Claims shown";
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
  form.addEventListener("input", show);
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
