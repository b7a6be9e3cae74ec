"""Settings of Sphinx for the pages of this folder: `make docs`."""

from xml.etree import ElementTree

manifest = ElementTree.parse("../package.xml").getroot()

project = "rpud_sim"
author = manifest.findtext("maintainer")
copyright = author
release = version = manifest.findtext("version")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

# Links to headings are checked as links to pages are.
myst_heading_anchors = 3
myst_links_external_new_tab = True

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
default_role = "code"

html_theme = "furo"
html_title = f"rpud_sim {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_theme_options = {"source_directory": "docs/"}
html_show_copyright = False
html_show_sphinx = False
