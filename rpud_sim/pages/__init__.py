"""Pages of comparisons, studies and campaigns.

A page is one HTML file. It needs no network and no script; its policy allows neither.

==============  ===================================================================================
module          what it holds
==============  ===================================================================================
``frame``       ``render_page``: a page from a template of jinja2, with plots as pictures in it
``plot``        descriptions of plots: ``Plot``, its layers, ``Axis`` and its ticks
``share``       style of a page, and its colours for light and dark
==============  ===================================================================================

A file::

    force = Plot("peak force", (Points("mean", weights, forces, low, high),), "It rises.",
                 Axis(unit="kN"), Axis("weight on bit", "N"))
    page = render_page("<h2>Force</h2>{{ figure(force) }}", "drill", force=force)
"""
