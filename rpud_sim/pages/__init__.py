"""Pages of the package: one frame and style, and plots that a reader can zoom.

A page is one HTML file. It needs no network; its policy allows no request and no script but ours.

================  =================================================================================
module            what it holds
================  =================================================================================
``frame``         ``render_page``: a page from a template of jinja2, with ``table``, ``plot``,
                  ``column``, ``grid``
``plot``          descriptions of plots: ``Plot``, its layers (``Line``, ``Envelope``,
                  ``Points``, ``Bars``, ``Stems``, ``Spans``, ``Rule``, ``Zone``), ``Axis``,
                  ``TimeColumn``, ``Mark``
``grid``          plots side by side: those over one quantity zoom together
``words``         ``described``: a plot with what its layers show, in words
``pointing``      values of a point in a cloud, beside the pointer
``flow``          ``flow_picture``: flow of power or energy, as an SVG
``extent``        ``readable_unit``: 3.5e-05 m as 35 µm
``theme``         colours for light and dark, by name
``figures``       Bokeh figures of plots (needs Bokeh: import it only where pages are made)
``embedding``     host elements, data and scripts of plots, for files and for a server
================  =================================================================================

A file::

    force = Plot("peak contact force", (Envelope("peak force", times, low, mean, high),),
                 "It is between 812 N and 2140 N.", Axis(unit="N"))
    shown = TimeColumn((force, ...), 0.0, 60.0, [Mark(FAULT, 31.0, "bias of wrench", 40.0)])
    page = render_page("<h2>Force</h2>{{ column(shown) }}", "drill", shown=shown)

A server calls ``figures.draw_column(column, names, live=True)`` and updates ``Drawn.sources`` and
``Drawn.marks``; their columns are in the docstring of ``Drawn``. Its template puts
``embedding.controls(group)`` and, for each plot, ``embedding.host(plot, name, group, inner)`` into
the page, where ``inner`` is the element into which Bokeh embeds the figure, and at its end
``embedding.server_scripts({group: group_content(begin, end, marks)})``; the style is
``frame.page_head_style()``. The script finds the figures when Bokeh has drawn them. Without
``begin`` and ``end`` (``{}``) the time is open; the button "whole" then sends the event
``rpud-whole`` to the document.

What a plot can do by itself: drag zooms, Ctrl and wheel zoom, double click shows all; all plots of
a group zoom together; a cursor with the values there; arrows move, + and - zoom, Home shows all,
Shift and arrows move the cursor; colours follow the reader's preference for light or dark.
"""
