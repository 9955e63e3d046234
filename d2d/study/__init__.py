"""Scenes, experiments, figures and claims of the book's chapters.

Each subpackage covers one subject:

- ``book``: what all pages share: style and grammar of figures, drawing, tables, animations, the
  ledger of claims.
- ``mixtures`` (chapter 2): Gaussian mixtures and expectation maximisation.
- ``point_sets`` (appendix B): registration of range scans with ICP and the NDT.
- ``line`` (chapters 4 and 5): scenes on a line, where a cost surface can be seen whole.
- ``estimation`` (chapters 6 and 8): optimisers, and the covariance of what they find.
- ``plane`` (chapters 9 and 10): the thesis's scenes in the plane and their evaluation.
- ``drives`` (chapters 12 and 13): simulated drives.
- ``road`` (chapters 14 and 15, appendices F to H): recorded drives.
- ``beyond`` (chapter 11): what the thesis left to future work.
- ``guides``: the pages on one's own radar.

Within a subpackage, each scene or experiment has a module named after it, ``figures.py`` draws, and
``claims.py`` (or the folder ``claims/``) judges the claims of the thesis.

Three modules serve all subpackages: ``runs.py`` runs Monte Carlo evaluations, ``results.py`` knows
where stored results are, and ``claims.py`` collects all claims in ``CLAIMS``.

Apart from the ``plot`` methods of `d2d.radar`, only this part of the package draws.
"""

from d2d.study.claims import CLAIMS
from d2d.study.plane import scenarios
from d2d.study.runs import MonteCarlo, monte_carlo

__all__ = ["CLAIMS", "MonteCarlo", "monte_carlo", "scenarios"]
