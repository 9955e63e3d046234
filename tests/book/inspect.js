// What a reader's browser makes of a page: functions that tests/book/browser.py calls in it.
// They look at <article>, which holds the page's own content, and return plain data.
window.inspectBook = (() => {
  const main = () => document.querySelector("article");
  const text = (node) => (node.textContent ?? "").replace(/\s+/g, " ").trim().slice(0, 80);

  /** Name an element so that a person finds it. */
  function name(element) {
    const id = element.closest("[id]")?.id;
    const label = element.tagName.toLowerCase() + [...element.classList].map((c) => "." + c).join("");
    return `${label} in #${id ?? "?"}: ${text(element)}`;
  }

  /** Unfold everything that is folded away, open every tab, and stop what moves: a colour in transition is neither the old nor the new. */
  function settle() {
    document.querySelectorAll("details").forEach((details) => (details.open = true));
    const still = document.createElement("style");
    still.textContent = "* { transition: none !important; animation: none !important; }"
      + ".sd-tab-set > .sd-tab-content { display: block !important; }";
    document.head.append(still);
  }

  /** The largest difference of a colour channel between two pixels of a picture, 0 to 255. */
  async function variation(image) {
    image.loading = "eager"; // it may not be in view
    try {
      await image.decode();
    } catch {
      return -1; // it did not load
    }
    const canvas = document.createElement("canvas");
    canvas.width = Math.max(1, Math.min(image.naturalWidth || 300, 300));
    canvas.height = Math.max(1, Math.min(image.naturalHeight || 300, 300));
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.fillStyle = "white"; // transparent is not a picture
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
    let largest = 0;
    for (let channel = 0; channel < 3; channel++) {
      let low = 255, high = 0;
      for (let i = channel; i < pixels.length; i += 4) {
        low = Math.min(low, pixels[i]);
        high = Math.max(high, pixels[i]);
      }
      largest = Math.max(largest, high - low);
    }
    return largest;
  }

  /** What the labels of figures stand for: a picture, or a table. */
  function figures() {
    const labelled = [...main().querySelectorAll("[id^='fig-']")];
    return labelled.filter((figure) => figure.querySelector("img, td")).map((figure) => figure.id);
  }

  async function images() {
    return Promise.all([...main().querySelectorAll("img")].map(async (image) => ({
      source: image.getAttribute("src"),
      alternative: image.getAttribute("alt")?.trim() ?? "",
      variation: await variation(image),
    })));
  }

  /** Formulas that MathJax left alone or could not read, and TeX that no one told it to typeset. */
  async function formulas() {
    await window.MathJax?.startup?.promise;
    const found = [];
    const math = [...main().querySelectorAll(".math")];
    for (const formula of math) {
      if (!formula.querySelector("mjx-container")) found.push("not typeset: " + name(formula));
    }
    for (const error of main().querySelectorAll("mjx-merror, [data-mjx-error]")) {
      found.push("TeX error: " + name(error.closest(".math") ?? error) + " " + (error.dataset.mjxError ?? ""));
    }
    for (const node of texts(main())) {
      if (node.parentElement.closest("pre, code, mjx-container, .math")) continue;
      if (/\\[([]|\\[a-zA-Z]{3,}|\$\$|\$[^$\s][^$]*\$/.test(node.data)) found.push("raw TeX: " + text(node));
    }
    return { count: math.length, found };
  }

  function* texts(root) {
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const node = walker.currentNode;
      if (node.data.trim() && !node.parentElement.closest("script, style, noscript, template")) yield node;
    }
  }

  /** Links as the browser resolves them, and references that Sphinx could not turn into links. */
  function links() {
    const unresolved = [...main().querySelectorAll(".xref.myst, .xref.std, .problematic, .system-message")]
      .filter((element) => !element.closest("a"));
    return {
      targets: [...document.querySelectorAll("a[href]")].map((link) => ({
        written: link.getAttribute("href"), resolved: link.href, label: text(link),
      })),
      unresolved: unresolved.map(name),
      next: document.querySelector("a.right-next")?.href ?? "",
    };
  }

  const visible = (element) => element.checkVisibility({ opacityProperty: true, visibilityProperty: true });

  /** What reaches past the window's edge without being in a box that scrolls. */
  function overflows() {
    const found = [];
    const width = document.documentElement.clientWidth;
    const whole = document.scrollingElement.scrollWidth;
    if (whole > width) found.push(`the page is ${whole} px wide in a window of ${width} px`);
    let outermost = null;
    for (const element of main().querySelectorAll("*")) {
      if (element.closest("mjx-assistive-mml") || outermost?.contains(element) || !visible(element)) continue;
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

  /** Pictures shown at less than a share of the size they were drawn in, where labels can no longer be read. The page of
      all figures only leads to them. */
  function shrunken(least) {
    // a figure of a notebook says both, and has twice as many pixels; a card's has half as many again
    const drawn = ({ naturalWidth, style, className }) =>
      style.height ? parseFloat(style.width) : naturalWidth / (className.includes("sd-card-img") ? 1.5 : 1);
    return [...main().querySelectorAll("img:not(.gallery img)")]
      .filter((image) => image.checkVisibility()) // not the other form of a figure
      .map((image) => [image.getBoundingClientRect().width / drawn(image), image])
      .filter(([share]) => share < least)
      .map(([share, image]) => `${image.getAttribute("src")} at ${share.toFixed(2)} of its size`);
  }

  const pixel = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });

  const colors = new Map(); // a page has few

  /** Any CSS colour as [red, green, blue, alpha], each 0 to 1. */
  function rgba(color) {
    if (!colors.has(color)) {
      pixel.clearRect(0, 0, 1, 1);
      pixel.fillStyle = color;
      pixel.fillRect(0, 0, 1, 1);
      colors.set(color, [...pixel.getImageData(0, 0, 1, 1).data].map((value) => value / 255));
    }
    return colors.get(color);
  }

  const over = (top, below) => [0, 1, 2].map((i) => top[3] * top[i] + (1 - top[3]) * below[i]);

  function background(element) {
    const layers = [];
    for (; element; element = element.parentElement) {
      const layer = rgba(getComputedStyle(element).backgroundColor);
      layers.push(layer);
      if (layer[3] === 1) break;
    }
    return layers.reduceRight((below, layer) => over(layer, below), [1, 1, 1]);
  }

  /** Relative luminance and contrast ratio as WCAG 2 defines them. */
  function luminance(color) {
    const [r, g, b] = color.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  }

  function ratio(one, other) {
    const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  }

  /** Text that has less contrast to its ground than `least`, once for each kind of element. */
  function faint(least) {
    const found = new Map();
    for (const element of new Set([...texts(main())].map((node) => node.parentElement))) {
      if (!visible(element) || element.closest("mjx-assistive-mml, .headerlink")) continue;
      const style = getComputedStyle(element);
      const ground = background(element);
      const contrast = ratio(over(rgba(style.color), ground), ground);
      const kind = `${style.color} on ${ground.map((c) => Math.round(255 * c))}`;
      if (contrast < least && !found.has(kind)) {
        found.set(kind, `${contrast.toFixed(2)} (${kind}): ${name(element)}`);
      }
    }
    return [...found.values()];
  }

  /** Code, printed text and formulas that are wider than the box they stand in: cut, or to be scrolled. */
  function cut() {
    return [...main().querySelectorAll("pre, div.math, mjx-container[display], .claim, .chapter-box")]
      .filter((box) => visible(box) && box.scrollWidth > box.clientWidth + 1)
      .map((box) => `${box.scrollWidth - box.clientWidth} px: ${name(box)}`);
  }

  /** Figures, formulas and moving pictures that a phone would have to scroll sideways. */
  function pushed() {
    const boxes = "figure:has(> img), .cell_output:has(> img), .cell_output:has([data-controls]), div.math, mjx-container[display]";
    return [...main().querySelectorAll(boxes)]
      .filter((box) => visible(box) && box.scrollWidth > box.clientWidth + 1)
      .map((box) => `${box.scrollWidth - box.clientWidth} px: ${name(box)}`);
  }

  /** Tables of few columns, but folded ones, that a phone scrolls by more than another machine's font makes up for. */
  function crowded(columns) {
    const slack = 12;
    return [...main().querySelectorAll(".measured-scroll, .pst-scrollable-table-container")]
      .filter((box) => visible(box) && !box.closest("details") && box.scrollWidth > box.clientWidth + slack)
      .filter((box) => [...box.querySelectorAll("tr")].at(-1).children.length <= columns)
      .map((box) => `${box.scrollWidth - box.clientWidth} px: ${name(box)}`);
  }

  /** Words of drawings in the page that are shown smaller than `least` pixels. */
  function tiny(least) {
    return [...main().querySelectorAll("svg text")].filter(visible)
      .map((word) => [word.getScreenCTM(), word]) // which may be turned
      .map(([{ a, b }, word]) => [parseFloat(getComputedStyle(word).fontSize) * Math.hypot(a, b), word])
      .filter(([size]) => size < least)
      .map(([size, word]) => `${size.toFixed(1)} px: ${name(word)}`);
  }

  /** Text that begins a line with a sign that belongs to the formula before it. */
  function orphans() {
    const found = [];
    for (const formula of main().querySelectorAll("span.math")) {
      const after = formula.nextSibling;
      if (after?.nodeType !== Node.TEXT_NODE || !/^[.,;:!?)]/.test(after.data) || !visible(formula)) continue;
      const sign = document.createRange();
      sign.setStart(after, 0);
      sign.setEnd(after, 1);
      if (sign.getBoundingClientRect().top > formula.getBoundingClientRect().bottom - 2) found.push(name(formula));
    }
    return found;
  }

  /** Captions that are thinner than the text, or have less contrast than `least`. */
  function pale(least) {
    return [...main().querySelectorAll("figcaption, caption")].filter((caption) => {
      const style = getComputedStyle(caption);
      const ground = background(caption);
      return style.fontWeight < 400 || ratio(over(rgba(style.color), ground), ground) < least;
    }).map(name);
  }

  /** Whatever the keyboard reaches and then looks as before, and formulas that it should not reach. */
  function unmarked() {
    const found = [...main().querySelectorAll("mjx-container[tabindex]")].map((each) => "a formula: " + name(each));
    const outlined = ({ outlineStyle, outlineWidth }) => outlineStyle !== "none" && parseFloat(outlineWidth) > 0;
    // The link of a whole tile has its outline on what it spreads over the tile.
    const look = (element) => {
      const [own, spread] = [getComputedStyle(element), getComputedStyle(element, "::after")];
      return { line: outlined(own) || (spread.content !== "none" && outlined(spread)), boxShadow: own.boxShadow };
    };
    const reached = "a[href], button, input:not([type=hidden]), select, textarea, summary, [tabindex='0']";
    for (const element of document.querySelectorAll(reached)) {
      if (!visible(element) || element.disabled || element.tabIndex < 0) continue;
      const before = look(element);
      element.focus({ preventScroll: true, focusVisible: true });
      if (document.activeElement !== element) continue;
      const after = look(element);
      if (!after.line && after.boxShadow === before.boxShadow) found.push(name(element));
      element.blur();
    }
    return found;
  }

  /** Figures that the text has not referred to by then. */
  function uncited() {
    const links = [...main().querySelectorAll("a[href^='#fig-'], a[href*='.html#fig-']")];
    return figures().filter((id) => {
      const figure = document.getElementById(id);
      return !links.some((link) => link.hash === `#${id}` && link.pathname === location.pathname
        && link.compareDocumentPosition(figure) & Node.DOCUMENT_POSITION_FOLLOWING && !figure.contains(link));
    });
  }

  /** How many windows the page is long. */
  const screens = () => document.scrollingElement.scrollHeight / window.innerHeight;

  return { cut, pushed, crowded, tiny, orphans, pale, unmarked, uncited, screens, settle, figures, images, formulas, links, overflows, shrunken, faint };
})();
