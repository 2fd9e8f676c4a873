"""From rows to one answer: problem, starts, alternation, number of modes, terms, doubts."""
