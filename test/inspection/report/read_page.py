"""A bag as a report sees it, and the page of a report as a browser reads it."""

import html.parser

import rpud_sim.bag
from rpud_sim.inspection.report.survey import survey

DURATION = 1.0
SCENARIO = """
faults:
  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.25, duration: 0.5}
  - {kind: lost_preload, magnitude: 0.5, onset: 0.9}
"""


class Page(html.parser.HTMLParser):
    """What a browser would make of a page: its text, its plots, its scripts and its tags."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.plots, self.texts, self.links, self.scripts = [], {}, [], [], []
        self._inside = ""
        self._title = ""
        self.feed(text)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.append(tag)
        self._inside = found.get("class", "") if tag == "span" else ""
        if tag == "script" and found.get("type") != "application/json":
            self._inside = "program"
        elif tag in ("script", "style"):
            self._inside = "hidden"
        self.links += [found[name] for name in ("src", "href") if name in found]

    def handle_data(self, data):
        if self._inside == "program":
            self.scripts.append(data)
        elif self._inside != "hidden":
            self.texts.append(data)
        if self._inside == "plot-title":
            self._title = data
        elif self._inside == "plot-seen":
            self.plots.setdefault(self._title, data)  # the first of this title
        self._inside = ""


def surveyed(path):
    with rpud_sim.bag.open(path) as bag:
        return survey(bag)
