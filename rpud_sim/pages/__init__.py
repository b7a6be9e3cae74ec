"""Pages of comparisons and campaigns.

A page is one HTML file. It needs no network and no script; its policy allows neither. ``frame``
makes a page from a template of jinja2, with pictures by matplotlib in it; ``share`` has its style,
with colours for light and dark.

A file::

    force = picture("peak force [kN]", "It rises.", lambda axes: axes.plot(weights, forces))
    page = render_page("<h2>Force</h2>{{ figures([force]) }}", "drill", force=force)
"""
