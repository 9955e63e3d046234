// What a reader's browser makes of a page: functions that tests/book/browser.py calls in it.
// They look at <article>, which holds the page's own content, and return what is wrong.
window.inspectBook = (() => {
  const main = () => document.querySelector("article");
  const text = (node) => (node.textContent ?? "").replace(/\s+/g, " ").trim().slice(0, 80);
  const visible = (element) => element.checkVisibility({ opacityProperty: true, visibilityProperty: true });

  /** Name an element so that a person finds it. */
  function name(element) {
    const label = element.tagName.toLowerCase() + [...element.classList].map((c) => "." + c).join("");
    return `${label} in #${element.closest("[id]")?.id ?? "?"}: ${text(element)}`;
  }

  /** Unfold everything that is folded away. */
  function unfold() {
    document.querySelectorAll("details").forEach((details) => (details.open = true));
  }

  /** Pictures that did not load, or say nothing to who cannot see them. */
  async function pictures() {
    const found = [];
    for (const image of main().querySelectorAll("img")) {
      image.loading = "eager"; // it may not be in view
      await image.decode().catch(() => found.push(`did not load: ${image.src}`));
      if (!image.alt.trim()) found.push(`no alternative text: ${image.src}`);
    }
    return found;
  }

  /** Formulas that are not typeset, and TeX that no one told Sphinx to typeset. */
  function formulas() {
    const left = [...main().querySelectorAll(".math")].filter((each) => !each.querySelector("math") || each.querySelector("merror"));
    const raw = [...texts(main())].filter((node) => /\\[([]|\\[a-zA-Z]{3,}|\$\$|\$[^$\s][^$]*\$/.test(node.data)
      && !node.parentElement.closest("pre, code, .math"));
    return [...left, ...raw.map((node) => node.parentElement)].map(name);
  }

  function* texts(root) {
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const node = walker.currentNode;
      if (node.data.trim() && !node.parentElement.closest("script, style, noscript, template")) yield node;
    }
  }

  /** Links as the browser resolves them. */
  function links() {
    return [...document.querySelectorAll("a[href]")].map((link) => link.href);
  }

  /** References that Sphinx could not turn into links. */
  function unresolved() {
    return [...main().querySelectorAll(".xref.myst, .xref.std, .problematic, .system-message")]
      .filter((element) => !element.closest("a")).map(name);
  }

  /** What reaches past the window's edge without being in a box that scrolls. */
  function overflows() {
    const found = [];
    const width = document.documentElement.clientWidth;
    const whole = document.scrollingElement.scrollWidth;
    if (whole > width) found.push(`the page is ${whole} px wide in a window of ${width} px`);
    let outermost = null;
    for (const element of main().querySelectorAll("*")) {
      if (outermost?.contains(element) || !visible(element)) continue;
      const box = element.getBoundingClientRect();
      if (box.width <= 1 || box.height <= 1 || (box.right <= width + 1 && box.left >= -1)) continue;
      if (scrolls(element.parentElement)) continue;
      outermost = element;
      found.push(`${Math.round(box.left)} to ${Math.round(box.right)} px: ${name(element)}`);
    }
    return found;
  }

  /** Whether something around an element scrolls and is itself within the window. */
  function scrolls(element) {
    for (; element && element !== document.body; element = element.parentElement) {
      if (!["auto", "scroll"].includes(getComputedStyle(element).overflowX)) continue;
      const box = element.getBoundingClientRect();
      if (box.right <= document.documentElement.clientWidth + 1 && box.left >= -1) return true;
    }
    return false;
  }

  return { unfold, pictures, formulas, links, unresolved, overflows };
})();
