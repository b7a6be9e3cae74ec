"""Template of the page of a comparison, for ``render_page``, and the headings of its tables."""

HEADINGS = {
    "runs": ("run", "bag", "drill", "run in the bag", "from [s]", "to [s]"),
    "bits": (
        "topic", "bits", "equal messages", "first difference [s]", "field", "in A", "here", "",
    ),
    "figures": (
        "quantity", "figure", "run", "A", "run", "unit", "difference", "interval",
        "relative [%]", "interval [%]", "p", "decision",
    ),
    "of_runs": (
        "quantity", "unit", "run", "values", "blocks", "mean", "interval", "median", "interval",
        "95 % below", "interval", "greatest",
    ),
}  # fmt: skip

BODY = """\
<nav aria-label="sections"><a href="#runs">Runs</a><a href="#settings">Settings</a>
<a href="#bits">Bits</a><a href="#figures">Figures</a><a href="#distributions">Distributions</a>
<a href="#time">Over time</a><a href="#timing">Timing</a></nav>
<p><b>{{ verdict }}</b></p>
<div class="tiles">{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>{% endfor %}</div>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<h2 id="runs">Runs</h2>
{{ table(headings.runs, runs, caption="A is the reference") }}

<h2 id="settings">Settings, commands and faults</h2>
{% if parameters %}
{{ table(headings.parameters, parameters, caption="Parameters that differ") }}
{% else %}<p class="none">No parameter differs.</p>{% endif %}
{% if versions %}
{{ table(headings.versions, versions, false, "Versions that differ") }}
{% else %}<p class="none">All runs are of the same software and machine.</p>{% endif %}
{% if commands %}
{{ table(headings.commands, commands, caption="Commands, aligned") }}
{% else %}<p class="none">No run has a command.</p>{% endif %}
{% if faults %}
{{ table(headings.faults, faults, caption="Faults, aligned, from onset to end") }}
{% else %}<p class="none">No run has a fault.</p>{% endif %}

<h2 id="bits">Bits</h2>
<p>Messages of each topic side by side, as far as both runs hold it. Times count from the beginning
of each run.</p>
{% for name, line, rows in bits %}
<h3>{{ name }}</h3>
<p>{{ line }}</p>
{{ table(headings.bits, rows, caption="Messages beside those of A") }}
{% endfor %}

<h2 id="figures">Figures</h2>
<p>Intervals are 95 % confidence intervals by a stationary block bootstrap, since impacts that
follow each other are not independent. Decisions are corrected for their number by Holm's method:
if the runs were of one kind, one comparison in twenty would name a difference.
{% if tolerance %}A difference up to {{ tolerance }} counts as none.{% endif %}</p>
{% for item in windows %}
<h3>{{ item.name }}</h3>
{% if item.intervals %}{{ plot(item.intervals) }}{% endif %}
{{ table(headings.figures, item.rows, caption="Figures of each run, and differences from A") }}
{{ table(headings.of_runs, item.of_runs, caption="Values of each run with their intervals") }}
{% endfor %}

<h2 id="distributions">Distributions</h2>
{% for name, plots in distributions %}
{% if distributions | length > 1 %}<h3>{{ name }}</h3>{% endif %}
{% for each in plots %}{{ plot(each) }}
{% endfor %}
{% else %}<p class="none">There are no values.</p>{% endfor %}
{% if not_drawn %}<p class="none">Not drawn: {{ not_drawn }} further segments.</p>{% endif %}

<h2 id="time">Over time</h2>
{% if over_time %}<p>Line: mean; band: least to greatest.</p>
{{ column(over_time) }}
{% else %}<p class="none">There are no series.</p>{% endif %}

<h2 id="timing">Timing of the machine</h2>
<p>These belong to the machine that ran the drill, not to the drill, and are not tested.</p>
{{ table(headings.timing, timing, caption="From the reports in status") }}
<p class="none">Made by rpud compare.</p>
"""
