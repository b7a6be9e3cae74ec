"""Pages hold their plots, their texts stay texts, and no script but ours may run."""

import base64
import hashlib
import json
import re
import subprocess
import sys

import numpy as np

from rpud_sim.pages.embedding import (
    bokeh_script,
    group_content,
    plots_script,
    server_scripts,
)
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import COMMAND, Axis, Line, Mark, Plot, TimeColumn

EVIL = "</script><script>alert(1)</script><!--"
LINE = Line(EVIL, np.arange(3.0), np.array([1.0, 2.0, 3.0]))


def page(**changes):
    plot = Plot(EVIL, (LINE,), EVIL, Axis(unit=EVIL))
    column = TimeColumn((plot, plot), 0.0, 2.0, [Mark(COMMAND, 1.0, EVIL)])
    return render_page("{{ column(shown) }}{{ plot(single) }}", "t", shown=column, single=plot)


def scripts(html):
    return re.findall(r"<script([^>]*)>(.*?)</script>", html, re.DOTALL)


def test_only_our_scripts_are_in_a_page_and_its_policy_names_them():
    html = page()
    programs = [text for attributes, text in scripts(html) if "json" not in attributes]
    assert programs == [bokeh_script(), plots_script()]
    policy = re.search('Content-Security-Policy" content="([^"]+)"', html)[1]
    allowed = policy.partition("script-src ")[2].split()
    digests = [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in programs
    ]
    assert allowed == [f"'sha256-{digest}'" for digest in digests]
    assert "default-src 'none'" in policy
    assert "alert(1)</script>" not in html


def test_texts_reach_the_scripts_as_they_are():
    contents = [json.loads(text) for attributes, text in scripts(page()) if "json" in attributes]
    [group] = [content for content in contents if "marks" in content]
    assert group["marks"][0]["text"] == EVIL
    assert (group["begin"], group["end"]) == (0.0, 2.0)
    assert sum("root_id" in content for content in contents) == 3


def test_a_server_s_page_has_the_theme_and_the_script_but_no_bokeh():
    found = server_scripts({"time": group_content(0.0, 1.0, [Mark(COMMAND, np.nan, "never")])})
    assert plots_script() in found
    assert bokeh_script() not in found
    assert '"marks":[]' in found


def test_bokeh_is_loaded_only_where_there_are_plots():
    script = (
        "import sys; import rpud_sim.cli.main; from rpud_sim.pages.frame import render_page\n"
        "render_page('{{ table((), [(1, 2)]) }}', 't'); print('bokeh' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n"
