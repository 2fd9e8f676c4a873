"""The doors of the package: data and parameters are checked here, each in one sentence."""
