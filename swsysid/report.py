"""Pages of HTML with their pictures inside, nothing to load: of identifications, of searches."""

from swsysid._effect_search.page import effect_page
from swsysid._recording_page.page import recording_page

__all__ = ["effect_page", "recording_page"]
