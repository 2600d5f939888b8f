"""One HTML page of a blind score, without network access."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

from jinja2 import Environment

from .whole_file import write_whole

TARGETS = {
    "single_identifiable_right": (
        "Single identifiable cause: effect and place right, nothing invented",
        ">=",
        0.97,
    ),
    "single_not_identifiable_found_or_tied": (
        "Single cause with rivals: found, or a rival named",
        ">=",
        None,
    ),
    "several_identifiable_found": ("Several causes: identifiable ones found", ">=", 0.92),
    "several_invented": ("Several causes: named ones that are invented", "<=", 0.03),
    "false_alarms": ("No effect: false alarms", "<=", 0.02),
    "outside_met": ("Outside the vocabulary: unknown or partial at the right place", ">=", 0.90),
    "outside_confidently_wrong": ("Outside the vocabulary: a confident wrong cause", "<=", 0.03),
    "outside_false_cause": (
        "Outside the vocabulary: a false cause beside what is told as unknown",
        "<=",
        None,
    ),
    "mixed_named_found": (
        "Causes beside an effect outside the vocabulary: identifiable ones found",
        ">=",
        None,
    ),
    "mixed_place": ("Beside causes, outside the vocabulary: its place is told", ">=", None),
    "mixed_false_cause": ("Beside causes, outside the vocabulary: a false cause", "<=", None),
    "mixed_explained": ("Beside causes, outside the vocabulary: told as explained", "<=", None),
}
"""The required figures, shown at the head of the page."""

TEMPLATE = """<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:"><title>Blind check</title><style>
body{font:16px/1.45 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem;color:#1c2430}
table{border-collapse:collapse;margin:.6rem 0 1.4rem}td,th{border-bottom:1px solid #d5dae2;padding:.25rem
.7rem;text-align:left}
th{background:#f2f4f8}.good{color:#136f3a;font-weight:600}.bad{color:#a61b1b;font-weight:600}.n{text-align:right;font-variant-numeric:tabular-nums}
img{max-width:26rem}code{background:#f2f4f8;padding:0 .2rem}</style></head><body>
<h1>Blind check: {{ s.sessions }} sessions</h1>
{% if s.without_result %}<p class="bad">{{ s.without_result|length }} sessions have no result: {{
s.without_result[:12]|join(', ') }}</p>{% endif %}
<table><tr><th>What</th><th>Share</th><th>95 % interval</th><th>Cases</th><th>Asked</th></tr>
{% for key, (text, sign, goal) in targets.items() %}{% set r = s[key] %}<tr><td>{{ text }}</td>
<td class="n {{ verdict(r, sign, goal) }}">{{ percent(r.rate) }}</td><td class="n">{{ percent(r.wilson95[0])
}} – {{ percent(r.wilson95[1]) }}</td>
<td class="n">{{ r.hits }} / {{ r.of }}</td><td class="n">{{ (('≥ ' if sign == '>=' else '≤ ') ~
percent(goal)) if goal is not none else '' }}</td></tr>{% endfor %}</table>
<h2>Probabilities</h2><p>Expected calibration error {{
'%.3f'|format(s.calibration.expected_calibration_error) if s.calibration.number else 'not known' }}
over {{ s.calibration.number }} named causes.</p>{% if chart %}<img alt="Reliability diagram"
src="data:image/png;base64,{{ chart }}">{% endif %}
<h2>Parameters and shrinkage</h2><p>Truth within the claimed 95 %: {{ percent(s.parameters.within_95.rate)
}} of {{ s.parameters.within_95.of }};
within 3 deviations: {{ percent(s.parameters.within_3_std.rate) }}. Of effects whose true law is just the
vocabulary's: {{ percent(s.parameters_of_the_vocabularys_laws.within_95.rate) }} of {{
s.parameters_of_the_vocabularys_laws.within_95.of }}. Claimed shrinkage within 5 points of the
true one of the named model: {{ percent(s.shrinkage.within_5_points.rate) }} of {{
s.shrinkage.within_5_points.of }}; where the gap is larger than the noise {{
percent(s.shrinkage.clear_gaps_within_5_points.rate) }} of {{ s.shrinkage.clear_gaps_within_5_points.of }};
the claimed interval covers it in {{ percent(s.shrinkage.interval_covers.rate) }}. Not judged, because the judge's
own model does not follow the simulated body even with the true causes: {{ s.shrinkage.without_judge }}.</p>
{% if s.seconds %}<p>Time a session: median {{ '%.2f'|format(s.seconds.median) }} s, worst {{
'%.2f'|format(s.seconds.worst) }} s by the clock{% if s.cpu_seconds %}; CPU median {{
'%.2f'|format(s.cpu_seconds.median) }} s, mean {{ '%.2f'|format(s.cpu_seconds.mean) }} s{% endif
%}.</p>{% endif %}
<h2>By effect (single, identifiable)</h2><table><tr><th>Effect</th><th>Right</th><th>95 %
interval</th><th>Named instead</th></tr>
{% for e, r in s.by_effect.items() %}<tr><td>{{ e }}</td><td class="n">{{ r.hits }} / {{ r.of }}</td>
<td class="n">{{ percent(r.wilson95[0]) }} – {{ percent(r.wilson95[1]) }}</td>
<td>{% for name, n in s.confusion.get(e, {}).items() if name != e %}{{ name }} × {{ n }} {% endfor
%}</td></tr>{% endfor %}</table> <h2>What failures have in common</h2>
{% for title, key in breakdowns %}<table><tr><th>{{ title }}</th><th>Found</th><th>Share</th><th>95 %
interval</th></tr>{% for name, r in s.breakdown[key].items() %}<tr><td>{{ name }}</td><td class="n">{{ r.hits
}} / {{ r.of }}</td><td class="n">{{ percent(r.rate) }}</td><td class="n">{{ percent(r.wilson95[0]) }} – {{
percent(r.wilson95[1]) }}</td></tr>{% endfor %}</table>{% endfor %}
{% if s.breakdown.invented_by_effect %}<p>Named and not there: {% for e, n in
s.breakdown.invented_by_effect.items() %}{{ e }} × {{ n }} {% endfor %}</p>{% endif %}
{% if s.breakdown.outside_by_kind %}<table><tr><th>Outside the vocabulary</th><th>Met</th><th>Abstained</th>
<th>Right place</th><th>Confidently wrong</th></tr>{% for kind, r in s.breakdown.outside_by_kind.items()
%}<tr><td>{{ kind }}</td>{% for key in ("met", "abstained", "right_place", "confidently_wrong") %}<td
class="n">{{ r[key].hits }} / {{ r[key].of }}</td>{% endfor %}</tr>{% endfor %}</table>{% endif %}
{% if s.by_hand %}<h2>Mounted by hand</h2><table>{% for title, key in by_hand %}<tr><td>{{ title }}</td><td class="n">{{
s.by_hand[key].hits }} / {{ s.by_hand[key].of }}</td><td class="n">{{ percent(s.by_hand[key].rate) }}</td></tr>{% endfor %}
<tr><td>Mounts within the claimed 95 %</td><td class="n">{{ s.by_hand.mounts.within_95.hits }} / {{ s.by_hand.mounts.within_95.of
}}</td><td class="n">{{ percent(s.by_hand.mounts.within_95.rate) }}</td></tr></table>{% endif %}
{% if s.first_day %}<h2>Mistakes of a first day</h2><table><tr><th>Mistake</th><th>Outcomes</th></tr>
{% for kind, counts in s.first_day.by_kind.items() %}<tr><td>{{ kind }}</td><td>{% for o, n in counts.items() %}{{ o }} × {{ n }}
{% endfor %}</td></tr>{% endfor %}</table>{% endif %}
<h2>Failures</h2>{% if s.failures
%}<table><tr><th>Session</th><th>True</th><th>Verdict</th><th>Said</th><th>Where</th></tr>
{% for f in s.failures %}<tr><td>{{ f.session }}</td><td>{{ f.true|join(', ') or 'nothing' }}</td><td>{{
f.verdict }}</td>
<td>{{ f.said|join(', ') }}</td><td>{{ f.where|join(', ') }}</td></tr>{% endfor %}</table>{% else
%}<p>None.</p>{% endif %}
<p>A <code>~</code> marks the right effect at another place. Intervals are Wilson's.</p></body></html>"""


BY_HAND = (
    ("Single identifiable cause named with only the set-up beside it", "single_named_with_only_set_up"),
    ("Single identifiable cause named", "single_named"),
    ("Several causes: identifiable ones named", "several_named"),
    ("No cause: only the set-up named", "none_only_set_up"),
)
FIRST_DAY = (
    ("Whole mistakes named, or refused at the border", "named_or_refused"),
    ("Whole mistakes: misled", "misled"),
    ("Small cause beside a mistake found", "small_cause_found"),
)


BREAKDOWNS = (
    ("Identifiable causes by the margin over their nearest rival (BIC)", "found_by_margin"),
    ("By effect", "found_by_effect"),
    ("By the number of causes", "found_by_number_of_causes"),
    ("By robot", "found_by_robot"),
)


def _percent(value: float | None) -> str:
    return "not known" if value is None else f"{100 * value:.1f} %"


def _verdict(entry: dict[str, Any], sign: str, goal: float | None) -> str:
    if entry["rate"] is None or goal is None:
        return ""
    return "good" if (entry["rate"] >= goal) == (sign == ">=") or entry["rate"] == goal else "bad"


def _chart(calibration: dict[str, Any]) -> str:
    """The reliability diagram as a PNG in base64."""
    if not calibration["number"]:
        return ""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2, 4.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    rows = calibration["bins"]
    x, y = [r["claimed"] for r in rows], [r["rate"] for r in rows]
    low = [max(0.0, r["rate"] - r["wilson95"][0]) for r in rows]
    high = [max(0.0, r["wilson95"][1] - r["rate"]) for r in rows]
    axes.errorbar(x, y, yerr=[low, high], fmt="o", color="#1f5fa8", capsize=3)
    for r in rows:
        axes.annotate(
            str(r["of"]), (r["claimed"], r["rate"]), textcoords="offset points", xytext=(7, -11), fontsize=8
        )
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02), xlabel="claimed probability", ylabel="share that was right")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return base64.b64encode(buffer.getvalue()).decode()


def write_page(score: dict[str, Any], path: Path) -> None:
    """Write the page of a score (the result of `score.score`) to `path`."""
    template = Environment(autoescape=True).from_string(TEMPLATE)
    html = template.render(
        s=score,
        targets=TARGETS,
        breakdowns=BREAKDOWNS,
        by_hand=BY_HAND,
        percent=_percent,
        verdict=_verdict,
        chart=_chart(score["calibration"]),
    )
    write_whole(path, html)
