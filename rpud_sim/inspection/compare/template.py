"""Template of the page of a comparison, for ``render_page``, and the headings of its tables."""

HEADINGS = {
    "runs": ("run", "bag", "drill", "run in the bag", "from [s]", "to [s]"),
    "bits": (
        "topic", "bits", "equal messages", "first difference [s]", "field", "in A", "here", "",
    ),
    "figures": (
        "quantity", "figure", "run", "A", "run", "difference", "95 % interval", "p", "decision",
    ),
    "of_runs": (
        "quantity", "run", "values", "blocks", "mean", "interval", "median", "interval",
        "95 % below", "interval", "greatest",
    ),
}  # fmt: skip

BODY = """\
<p class="verdict">{{ verdict }}</p>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<p>{% for name, bag in named %}{{ name }}: <code>{{ bag }}</code>{{ ". " if loop.last else "; " }}
{% endfor %}
{{ settings }}</p>
{% for item in windows %}
{% if loop.first %}
{% if windows | length > 1 %}<h2>{{ item.name }}</h2>{% endif %}
{% if item.plot %}{{ figure(item.plot) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
{% else %}
<details><summary>{{ item.name }}: {{ item.count }}</summary>
{% if item.plot %}{{ figure(item.plot) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
</details>
{% endif %}
{% endfor %}

<details id="figures"><summary>Figures in numbers</summary>
<p>Intervals are 95 % confidence intervals by a stationary block bootstrap, since impacts that
follow each other are not independent. Decisions are corrected for their number by Holm's method:
if the runs were of one kind, one comparison in twenty would name a difference.
{% if tolerance %}A difference up to {{ tolerance }} counts as none.{% endif %}</p>
{% for item in windows %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.rows, caption="Figures of each run, and differences from A") }}
{{ table(headings.of_runs, item.of_runs, caption="Values of each run with their intervals") }}
{% endfor %}
</details>

<details id="distributions"><summary>Distributions</summary>
<p>Share of the values in each of 60 classes [%].</p>
{% for name, plots in distributions %}
{% if distributions | length > 1 %}<h3>{{ name }}</h3>{% endif %}
{{ figures(plots, 20) }}
{% else %}<p class="none">There are no values.</p>{% endfor %}
{% if not_drawn %}<p class="none">Not drawn: {{ not_drawn }} further segments.</p>{% endif %}
</details>

<details id="time"><summary>Over time</summary>
{% if over_time %}<p>Line: mean; band: least to greatest.
{% if hidden %}{{ hidden }} commands are not drawn: their table has all.{% endif %}</p>
{{ figures(over_time, 30) }}
{% else %}<p class="none">There are no series.</p>{% endif %}
</details>

<details id="settings"><summary>Runs, settings, commands and faults</summary>
{{ table(headings.runs, runs, caption="A is the reference") }}
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
</details>

<details id="bits"><summary>Bits</summary>
<p>Messages of each topic side by side, as far as both runs hold it. Times count from the beginning
of each run.</p>
{% for name, line, rows in bits %}
<h3>{{ name }}</h3>
<p>{{ line }}</p>
{{ table(headings.bits, rows, caption="Messages beside those of A") }}
{% endfor %}
</details>

<details id="timing"><summary>Timing of the machine</summary>
<p>These belong to the machine that ran the drill, not to the drill, and are not tested.</p>
{{ table(headings.timing, timing, caption="From the reports in status") }}
</details>
"""
