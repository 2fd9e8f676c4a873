"""The doors of the package: data and parameters are checked here, each in one sentence.

*In*: what a user hands in. *Out*: arrays and values that all else may trust, or an error that says
what to do. `arrays` checks data, `parameters` values, `estimators` both as scikit-learn does.
"""
