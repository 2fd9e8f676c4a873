"""Displays in the manner of scikit-learn: ``from_estimator`` computes, ``plot`` draws."""
