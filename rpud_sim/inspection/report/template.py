"""Template of a report, for ``render_page``, and the headings of its tables."""

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
}  # fmt: skip

BODY = """\
{%- macro missing(text) %}
<p class="none">{{ text }}</p>
{%- endmacro %}
<nav><a href="#run">Run</a><a href="#impacts">Impacts</a><a href="#force">Contact force</a>
<a href="#energy">Energy</a><a href="#spectra">Spectra</a><a href="#series">Time series</a>
<a href="#timing">Timing</a><a href="#faults">Faults</a></nav>
<div class="tiles">{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>{% endfor %}</div>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<h2 id="run">The run</h2>
{{ table((), bag, false) }}
{% for rows in runs %}{{ table((), rows, false) }}{% else %}
{{ missing("The bag has no manifest: no recorder of rpud wrote it.") }}{% endfor %}
<h3>Topics</h3>
{{ table(headings.topics, topics) }}
{% if topics_more %}{{ missing("And " ~ topics_more ~ " more.") }}{% endif %}
<h3>Parameters</h3>
{% if parameters %}<div class="parameters">{{ table((), parameters, false) }}</div>
{% else %}{{ missing("None are told: neither a manifest nor the topic journal is in the bag.") }}
{% endif %}
{%- for name, rows, more in journals %}
<h3>Changes of the simulation: {{ name }}</h3>
{{ table(headings.journal, rows) }}
{% if more %}{{ missing("And " ~ more ~ " more.") }}{% endif %}
{%- endfor %}

<h2 id="impacts">Impacts</h2>
{%- for item in impacts %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.figures) }}
{% if item.over_time %}{{ picture(item.over_time, "impacts over time") }}{% endif %}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="force">Distribution of the contact force</h2>
{%- for item in impacts if item.distributions %}
<h3>{{ item.name }}</h3>
{{ picture(item.distributions, "distributions over the impacts") }}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="energy">Energy</h2>
{%- for item in impacts if item.energy %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.energy) }}
{% if item.flow %}<p>Mean powers over the run, from the reports in status.</p>
{{ picture(item.flow, "flow of power through the drill") }}
{%- else %}{{ missing("No flow of power: record the topic status.") }}{% endif %}
{%- else %}
{{ missing("No impacts: record the topic contact_force.") }}
{%- endfor %}

<h2 id="spectra">Spectra</h2>
{%- for item in waveforms %}
<h3>{{ item.name }}</h3>
{%- if item.spectra %}
<p>Power spectral densities by Welch's method: {{ item.segments }} segments of {{ item.length }}
samples at {{ item.rate }}, Hann's window, half overlapping, without their means.</p>
{{ picture(item.spectra, "power spectral densities") }}
{%- else %}{{ missing("Too few samples for a spectrum.") }}{% endif %}
{%- else %}
{{ missing("No spectra: record the topic waveform; slower samples would alias the vibration.") }}
{%- endfor %}

<h2 id="series">Time series</h2>
{%- for item in waveforms if item.closer %}
<h3>A closer look: {{ item.name }}</h3>
{{ picture(item.closer, "some milliseconds of the waveform") }}
{%- endfor %}
<p>Line: mean; band: least to greatest in each thousandth of the time. Values that are not finite,
or beyond 1e150, are left out. Quantiles are exact to about a hundredth of the range.</p>
{%- for item in series %}
<h3>{{ item.name }}</h3>
{% if item.picture %}{{ picture(item.picture, "time series of " ~ item.name) }}{% endif %}
{% if item.constant %}{{ missing("Constant: " ~ item.constant) }}{% endif %}
{% if item.more %}{{ missing(item.more) }}{% endif %}
{{ table(headings.series, item.rows) }}
{%- else %}
{{ missing("No topic has numbers to show.") }}
{%- endfor %}
{% if series_more %}{{ missing("Not drawn, too many topics: " ~ series_more) }}{% endif %}

<h2 id="timing">Timing health</h2>
<p>Log − stamp is the time from the stamp of a message to its recording; for a block it counts from
the stamp of the last row. Jitter is the distance from its 1 % to its 99 % quantile.</p>
{{ table(headings.timing, timing) }}
{%- for name, rows in statuses %}
<h3>The drill's own account: {{ name }}</h3>
{{ table((), rows, false) }}
{%- else %}
{{ missing("No account of the drill's own timing: record the topic status.") }}
{%- endfor %}
{% if delays %}<h3>Log − stamp over time</h3>{{ picture(delays, "log minus stamp") }}{% endif %}

<h2 id="faults">Faults</h2>
{%- for item in faults %}
<h3>{{ item.name }}</h3>
{%- if item.rows %}
{{ picture(item.picture, "faults over time") }}
{{ table(headings.faults, item.rows) }}
{% if item.more %}{{ missing("More faults were reported than are listed.") }}{% endif %}
{%- else %}{{ missing("There were none.") }}{% endif %}
{%- else %}
{{ missing("Nothing is known of faults: record the topic faults.") }}
{%- endfor %}
<p class="none">Made by rpud report.</p>
"""
