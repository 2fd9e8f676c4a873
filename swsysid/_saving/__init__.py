"""Fitted models as text: what may be in a file, and how it is written and read.

*In*: a fitted model. *Out*: a file without code, and the model again. In reading order: `files`
(save and load), `values` (numbers and objects as JSON), `classes` (what a file may name).
"""
