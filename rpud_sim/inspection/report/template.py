"""Template of a report, for ``render_page``, and the headings of its tables."""

from rpud_sim.inspection.report.account_rows import ACCOUNT_HEADING, PERIOD_HEADING

HEADINGS = {
    "topics": ("topic", "type", "messages", "rate [Hz]", "lost"),
    "series": (
        "field", "unit", "values", "mean", "deviation", "least", "5 %", "median", "95 %",
        "greatest", "left out",
    ),
    "figures": ("figure", "value", ""),
    "timing": (
        "topic", "messages", "lost", "missing in sequence", "interval: median [ms]", "99 % [ms]",
        "greatest [ms]", "log − stamp: mean [ms]", "greatest [ms]", "jitter [ms]", "clock set",
    ),
    "faults": ("number", "kind", "channel", "magnitude", "onset [s]", "clear [s]"),
    "journal": ("time [s]", "kind", "content"),
    "periods": PERIOD_HEADING,
    "account": ACCOUNT_HEADING,
    "properties": ("property", "value"),
    "parameters": ("parameter", "value"),
}  # fmt: skip

BODY = """\
{%- macro missing(text) %}
<p class="none">{{ text }}</p>
{%- endmacro %}
{%- macro side_by_side(plots) %}
<div class="plots" style="--least:26em">
{% for item in plots %}{{ plot(item) }}{% endfor %}</div>
{%- endmacro %}
<nav aria-label="Sections"><a href="#run">Run</a><a href="#impacts">Impacts</a>
<a href="#segments">Segments</a><a href="#force">Contact force</a><a href="#energy">Energy</a>
<a href="#spectra">Spectra</a><a href="#series">Time series</a><a href="#timing">Timing</a>
<a href="#faults">Faults</a></nav>
<div class="tiles">{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>{% endfor %}</div>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<h2 id="run">The run</h2>
{{ table(headings.properties, bag, false, "The bag") }}
{% for rows in runs %}{{ table(headings.properties, rows, false, "The run, by its recorder") }}
{%- else %}
{{ missing("The bag has no manifest: no recorder of rpud wrote it.") }}{% endfor %}
<h3>Topics</h3>
{{ table(headings.topics, topics, caption="Topics of the bag") }}
{% if topics_more %}{{ missing("And " ~ topics_more ~ " more.") }}{% endif %}
<h3>Parameters</h3>
{% if parameters %}<details><summary>{{ parameters | length }} parameters</summary>
{{ table(headings.parameters, parameters, false, "Parameters") }}</details>
{% else %}{{ missing("None are told: neither a manifest nor the topic journal is in the bag.") }}
{% endif %}
{%- for name, rows, more in journals %}
<h3>Changes of the simulation: {{ name }}</h3>
{{ table(headings.journal, rows, caption="Changes in " ~ name) }}
{% if more %}{{ missing("And " ~ more ~ " more.") }}{% endif %}
{%- endfor %}

<h2 id="impacts">Impacts</h2>
<p>All plots over time zoom together: drag over a plot, or use the buttons. With the keyboard:
arrows move, + and − zoom, Home shows all, Shift and arrows move the cursor. On every plot over
time, <span class="mark-command">lines</span> are commands, <span class="mark-fault">areas</span>
are faults from onset to end, and <span class="mark-gap">hatched areas</span> are gaps, in which
messages are missing.</p>
{%- for item in impacts %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.figures, caption="Figures of the whole run") }}
{% if item.over_time %}{{ column(item.over_time) }}{% endif %}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="segments">Segments between commands and faults</h2>
<p>A segment ends where a command takes effect, and where a fault begins or ends. Its impact rate
is that of the intervals between its impacts. Forces are those of single contacts, and the samples
of the reacting force.</p>
{%- for item in segments %}
<h3>{{ item.name }}</h3>
{% if not item.known %}
{{ missing("One segment: record the topics journal and faults.") }}{% endif %}
{{ table(headings.periods, item.rows, caption="Statistics by segment: " ~ item.name) }}
{% if item.more %}{{ missing("The last segment holds the rest of the run: " ~ item.more
 ~ " further commands and faults.") }}{% endif %}
{%- else %}
{{ missing("No segments: record the topic contact_force, and the topics journal and faults.") }}
{%- endfor %}

<h2 id="force">Distribution of the contact force</h2>
{%- for item in impacts if item.distributions %}
<h3>{{ item.name }}</h3>
{{ side_by_side(item.distributions) }}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="energy">Energy</h2>
{%- for item in impacts if item.energy %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.energy, caption="Energy and power of the impacts") }}
{% if item.account %}
<p>The energy account, from the powers in status over {{ item.reported }}.</p>
{{ item.flow }}
{{ table(headings.account, item.account, caption="Energy account") }}
{%- else %}{{ missing("No flow of power: record the topic status.") }}{% endif %}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="spectra">Spectra</h2>
{%- for item in waveforms %}
<h3>{{ item.name }}</h3>
{%- if item.spectra %}
<p>Power spectral densities by Welch's method: {{ item.segments }} segments of {{ item.length }}
samples at {{ item.rate }}, Hann's window, half overlapping, without their means. Of narrow ranges
of frequency the greatest value is drawn.</p>
{{ grid("spectra-" ~ loop.index, item.spectra) }}
{%- else %}{{ missing("Too few samples for a spectrum.") }}{% endif %}
{%- else %}
{{ missing("No spectra: record the topic waveform; slower samples would alias the vibration.") }}
{%- endfor %}

<h2 id="series">Time series</h2>
{%- for item in waveforms if item.closer %}
<h3>A closer look: {{ item.name }}</h3>
{{ column(item.closer) }}
{%- endfor %}
<p>A value that changes seldom is drawn as it is, in steps. Of others: the mean, and the band from
least to greatest in each thousandth of the time. Values that are not finite, or beyond 1e150, are
left out. Quantiles are exact to about a hundredth of the range.</p>
{%- for item in series %}
<h3>{{ item.name }}</h3>
{% if item.column %}{{ column(item.column) }}{% endif %}
{% if item.constant %}{{ missing("Constant: " ~ item.constant) }}{% endif %}
{% if item.more %}{{ missing(item.more) }}{% endif %}
{{ table(headings.series, item.rows, caption="Statistics of " ~ item.name) }}
{%- else %}
{{ missing("No topic has numbers to show.") }}
{%- endfor %}
{% if series_more %}{{ missing("Not drawn, too many topics: " ~ series_more) }}{% endif %}

<h2 id="timing">Timing health</h2>
<p>Log − stamp is the time from the stamp of a message to its recording; for a block it counts from
the stamp of the last row. Jitter is the distance from its 1 % to its 99 % quantile.</p>
{{ table(headings.timing, timing, caption="Losses, intervals and delays") }}
{%- for name, rows in statuses %}
<h3>The drill's own account: {{ name }}</h3>
{{ table(headings.properties, rows, false, "Timing and counters in " ~ name) }}
{%- else %}
{{ missing("No account of the drill's own timing: record the topic status.") }}
{%- endfor %}
{% if delays %}<h3>Log − stamp over time</h3>{{ column(delays) }}{% endif %}

<h2 id="faults">Faults</h2>
{% if faults_plot %}{{ column(faults_plot) }}{% endif %}
{%- for item in faults %}
<h3>{{ item.name }}</h3>
{%- if item.rows %}
{{ table(headings.faults, item.rows, caption="Faults in " ~ item.name) }}
{% if item.more %}{{ missing("More faults were reported than are listed.") }}{% endif %}
{%- else %}{{ missing("There were none.") }}{% endif %}
{%- else %}
{{ missing("Nothing is known of faults: record the topic faults.") }}
{%- endfor %}
<p class="none">Made by rpud report.</p>
"""
