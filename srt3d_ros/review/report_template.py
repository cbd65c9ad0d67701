"""The Jinja2 template of the report: one HTML file without scripts or external files, for dark and light screens."""

TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="srt3d_ros {{ version }}">
<title>{{ title }}</title>
<style>
:root { color-scheme: light dark; --ink: #1b1f24; --dim: #5d6672; --page: #f6f7f9; --card: #fff; --line: #dfe3e8;
        --bad: #b3400e; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8eaed; --dim: #98a1ad; --page: #0d1015; --card: #161b22; --line: #2a313b; --bad: #ff8f57; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); font: 16px/1.5 system-ui, "Segoe UI", sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 24px 16px 48px; }
h1 { margin: 0; font-size: 1.7rem; overflow-wrap: anywhere; }
h2 { margin: 40px 0 12px; font-size: 1.2rem; }
h3 { margin: 0 0 4px; font-size: .95rem; font-weight: 600; }
p, figcaption, .dim { color: var(--dim); }
p { margin: 4px 0; }
.note { color: var(--bad); }
figure { margin: 0; }
figcaption { font-size: .88rem; margin-top: 6px; overflow-wrap: anywhere; }
figcaption b { color: var(--ink); }
img { width: 100%; height: auto; border-radius: 8px; display: block; background: #0d1015; }
img.map { image-rendering: pixelated; max-width: 420px; }
.grid { display: grid; gap: 16px; grid-template-columns: repeat(auto-fit, minmax(min(100%, var(--least)), 1fr)); }
.tables { align-items: start; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 12px; min-width: 0; }
.card svg { width: 100%; height: auto; display: block; }
.figure { font-size: 1.4rem; font-weight: 650; line-height: 1.2; font-variant-numeric: tabular-nums; }
.bad .figure { color: var(--bad); }
table { border-collapse: collapse; width: 100%; font-size: .88rem; }
td, th { padding: 4px 8px 4px 0; text-align: left; vertical-align: top; border-top: 1px solid var(--line);
         overflow-wrap: anywhere; }
th { font-weight: 400; color: var(--dim); width: 42%; }
tr:first-child > * { border-top: 0; }
.log td:nth-child(-n+2) { white-space: nowrap; width: 1%; color: var(--dim); font-variant-numeric: tabular-nums; }
.log .WARN td, .log .ERROR td, .log .CRITICAL td { color: var(--bad); }
summary { cursor: pointer; }
</style>
</head>
<body>
<main>
<header>
<h1>{{ name }}</h1>
<p>{{ subtitle }}</p>
{% for note in notes %}<p class="note">{{ note }}</p>
{% endfor %}</header>

<h2>At a glance</h2>
<section class="grid" style="--least: 125px">
{% for headline in headlines %}<div class="card{{ ' bad' if headline.bad }}"><div class="figure">{{ headline.figure }}\
</div><div class="dim">{{ headline.what }}</div></div>
{% endfor %}</section>

<h2>{{ gallery.typical.title }}</h2>
<figure><img src="{{ gallery.typical.uri }}" alt="{{ gallery.typical.title }}">
<figcaption>{{ gallery.typical.caption }}. Coloured by range, shaded by intensity; the scale bar holds at the middle of
the cloud. Drawn by {{ gallery.by }}.</figcaption></figure>

{% if gallery.ends %}<h2>Its extremes</h2>
<section class="grid" style="--least: 420px">
{% for picture in gallery.ends %}<figure><img src="{{ picture.uri }}" alt="{{ picture.title }}">
<figcaption><b>{{ picture.title }}</b>. {{ picture.caption }}</figcaption></figure>
{% endfor %}</section>
{% endif %}
{% if gallery.strip|length > 1 %}<h2>Over time</h2>
<section class="grid" style="--least: 165px">
{% for picture in gallery.strip %}<figure><img src="{{ picture.uri }}" alt="cloud at {{ picture.title }}">
<figcaption><b>{{ picture.title }}</b><br>{{ picture.caption }}</figcaption></figure>
{% endfor %}</section>
{% endif %}
{% if gallery.images %}<h2>Images of the typical frame</h2>
<section class="grid" style="--least: 150px">
{% for picture in gallery.images %}<figure><img class="map" src="{{ picture.uri }}" alt="{{ picture.title }}">
<figcaption><b>{{ picture.title }}</b>, {{ picture.caption }}</figcaption></figure>
{% endfor %}</section>
{% endif %}
<h2>Figures over time</h2>
<section class="grid" style="--least: 440px">
{% for title, svg in plots %}<div class="card"><h3>{{ title }}</h3>{{ svg }}</div>
{% endfor %}</section>
{% if gaps %}<p>Shaded: gaps, where frames are missing.</p>
<details{{ ' open' if gaps|length <= 10 }}><summary>{{ gap_count }} gap{{ 's' if gap_count != 1 }}</summary>
<table>{% for gap in gaps %}<tr><th>after frame {{ gap.after_frame }}, at {{ '%.2f'|format(gap.at_s) }} s</th>
<td>{{ '%.3g'|format(gap.seconds) }} s, about {{ gap.missing }} frame{{ 's' if gap.missing != 1 }}</td></tr>
{% endfor %}</table></details>
{% endif %}
{% if log %}<h2>Log</h2>
<details{{ ' open' if log|length <= 40 }}><summary>{{ log_summary }}</summary>
<table class="log">{% for line in log %}<tr class="{{ line.level }}"><td>{{ line.at }}</td><td>{{ line.level }}</td>\
<td>{{ line.text }}</td></tr>
{% endfor %}</table></details>
{% endif %}
<h2>In figures</h2>
<div class="card"><table>{% for what, figure in rows %}<tr><th>{{ what }}</th><td>{{ figure }}</td></tr>
{% endfor %}</table></div>

<h2>What it was made with</h2>
<section class="grid tables" style="--least: 320px">
{% for title, facts in tables %}<div class="card"><h3>{{ title }}</h3>
<table>{% for fact, value in facts %}<tr><th>{{ fact }}</th><td>{{ value }}</td></tr>
{% endfor %}</table></div>
{% endfor %}</section>
</main>
</body>
</html>
"""
