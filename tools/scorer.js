// What a match counts in the search.  Sphinx takes a word of any heading for as good as all words of the page's title:
// here the share of the asked words that stand in the title comes first.
var Scorer = {
  score([, title, , , score]) {
    const asked = new URLSearchParams(location.search).get("q").toLowerCase().match(/\w+/g) ?? [];
    const named = asked.filter((word) => title.toLowerCase().includes(word));
    return score + 100 * named.length / Math.max(asked.length, 1);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
