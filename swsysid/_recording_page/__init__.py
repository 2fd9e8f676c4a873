"""The page of an identification: what a model makes of the recordings, one file with its pictures.

Data in: a fitted model and the recordings of its fit. Data out: HTML with everything in it, the
library that draws and hovers included (uPlot, 53 kB), so that it opens without network.

- `tracks`: along each recording the rollout, the modes of both, what is left, the guards;
- `charts`: which panels are drawn of it, as JSON for `assets/charts.js`;
- `page`: the page.
"""
