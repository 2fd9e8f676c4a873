"""The page of a search for effects: HTML with its pictures inside, nothing to load."""

from swsysid._effect_search.page import effect_page

__all__ = ["effect_page"]
