// On a phone, a wide figure scrolls in a box of its own instead of shrinking until its labels cannot be read: book.css
// needs to know how wide each picture was drawn, which of a figure with two pixels for each of the page its style says.
document.addEventListener("DOMContentLoaded", () => {
  for (const image of document.querySelectorAll("article figure img, article .cell_output > img")) {
    const measure = () => image.style.setProperty("--drawn", image.style.width || `${image.naturalWidth}px`);
    if (image.complete) measure();
    else image.addEventListener("load", measure);
  }
});
