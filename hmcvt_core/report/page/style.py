# SPDX-License-Identifier: Apache-2.0
"""Style sheet and fill patterns of the page."""

STYLE = """
:root { color-scheme: light; --ink: #1b1f24; --soft: #57606a; --rule: #d5dae0; --paper: #fff;
  --shade: #f4f6f8; --below: #b3480a; --above: #1f5f99; --strong: #8a3500; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--shade); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main, header.top { max-width: 1240px; margin: 0 auto; padding: 0 20px; }
header.top { padding-top: 24px; }
h1 { font-size: 15px; font-weight: 600; color: var(--soft); margin: 0 0 10px;
  overflow-wrap: anywhere; }
.verdict { font-size: 25px; line-height: 1.35; font-weight: 600; margin: 0 0 10px;
  max-width: 56em; }
.badge { display: inline-block; border: 2px solid var(--ink); border-radius: 4px;
  padding: 1px 10px; margin: 0 0 12px; font-weight: 700; font-size: 15px; }
.lead { margin: 0 0 18px; color: var(--soft); max-width: 62em; }
h2 { font-size: 20px; margin: 0 0 6px; }
h3 { font-size: 16px; margin: 18px 0 8px; }
h4 { font-size: 16px; margin: 0; }
section { background: var(--paper); border: 1px solid var(--rule); border-radius: 8px;
  padding: 18px 20px 20px; margin: 0 0 18px; }
p { margin: 6px 0 12px; max-width: 72em; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(155px, 1fr)); gap: 12px;
  margin: 0 0 18px; }
.card { background: var(--paper); border: 1px solid var(--rule); border-radius: 8px;
  padding: 12px 14px; }
.card .name { font-size: 13.5px; color: var(--soft); display: block; }
.card .value { font-size: 22px; font-weight: 700; display: block; line-height: 1.3; }
.card .more { font-size: 13.5px; color: var(--soft); display: block; }
.figures { display: grid; gap: 8px 18px; margin: 8px 0;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr)); }
.figures > svg { width: 100%; max-width: 560px; height: auto; display: block; }
.caption { font-size: 14px; color: var(--soft); }
svg text { font-size: 13.5px; fill: var(--ink); font-family: inherit; }
svg text.label { fill: var(--soft); }
svg text.heading { font-weight: 600; font-size: 14px; }
.frame { fill: none; stroke: #8b949e; }
.grid { stroke: #e6e9ed; }
.tick, .zero { stroke: #57606a; }
.below { fill: var(--below); stroke: #fff; stroke-width: .8; }
.above { fill: var(--above); stroke: #fff; stroke-width: .8; }
.below.pale { fill: #f6d3b8; stroke: var(--below); }
.above.pale { fill: #cfe1f2; stroke: var(--above); }
.within { fill: #9aa3ad; }
.region { fill: none; stroke: #111; stroke-width: 2; }
.region.weak { stroke-dasharray: 6 4; }
.flag { fill: #111; }
svg text.flag-text { fill: #fff; font-weight: 700; font-size: 13px; }
.band { fill: #e9edf1; }
.sample { fill: #31506e; fill-opacity: .75; stroke: #fff; stroke-width: .6; }
.beyond { fill: #fff; stroke: #31506e; stroke-width: 1.4; }
.trend { fill: none; stroke: #111; stroke-width: 2.4; stroke-linejoin: round; }
.part { stroke: #fff; stroke-width: 1; }
.part-0 { fill: #3d444c; } .part-1 { fill: url(#dots); stroke: #8b949e; }
.part-2 { fill: #8db9de; } .part-3 { fill: #2c6ca5; } .part-4 { fill: url(#lines); }
.part-5 { fill: #ecd9a6; stroke: #b59a4e; } .part-6 { fill: #fff; stroke: #3d444c; }
.part-new-0 { fill: url(#effect); stroke: #111; }
.part-new-1 { fill: url(#effect-2); stroke: #111; }
ul.legend { list-style: none; margin: 6px 0; padding: 0; display: flex; flex-wrap: wrap;
  gap: 4px 20px; font-size: 14px; }
ul.legend li { display: flex; align-items: center; gap: 7px; }
.icon { flex: none; }
.group { padding: 2px 0 4px; }
.bracket { border: solid #111; border-width: 2px 0 2px 4px; border-radius: 10px 0 0 10px;
  padding: 2px 0 10px 16px; margin: 14px 0; }
.bracket > h3 { margin-top: 8px; }
.cause { border-top: 1px solid var(--rule); padding: 12px 0 8px; }
.bar-row { display: grid; grid-template-columns: minmax(190px, 24%) 1fr 66px; gap: 4px 14px;
  align-items: center; }
.form { font-weight: 400; color: var(--soft); }
.bar { width: 100%; height: 18px; display: block; }
.track { fill: #e6e9ed; } .fill { fill: #31506e; }
.share { text-align: right; white-space: nowrap; font-weight: 700;
  font-variant-numeric: tabular-nums; }
.tags { margin: 6px 0; }
.tag { display: inline-block; border: 1px solid #8b949e; border-radius: 10px; padding: 0 9px;
  font-size: 13.5px; margin: 2px 6px 2px 0; }
.tag.doubt { border: 2px solid var(--strong); color: var(--strong); font-weight: 700; }
dl { display: grid; grid-template-columns: minmax(140px, 15%) 1fr; gap: 3px 14px; margin: 8px 0;
  font-size: 15px; }
dt { color: var(--soft); } dd { margin: 0; min-width: 0; overflow-wrap: anywhere; }
dd ul { margin: 0; padding-left: 18px; }
.scroll { overflow-x: auto; max-width: 100%; margin: 8px 0; }
table { border-collapse: collapse; font-size: 14.5px; }
th, td { padding: 5px 16px 5px 0; border-bottom: 1px solid var(--rule); text-align: left;
  vertical-align: bottom; }
th { font-weight: 600; color: var(--soft); } td { white-space: nowrap; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
ul.todo li, ul.notes li { margin: 3px 0; }
.defs { position: absolute; width: 0; height: 0; }
@media (max-width: 620px) {
  main, header.top { padding: 0 12px; } header.top { padding-top: 16px; }
  section { padding: 14px 12px; } .verdict { font-size: 20px; }
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: 6px; }
  .cards { grid-template-columns: 1fr 1fr; gap: 8px; } .card { padding: 10px; }
  .card .value { font-size: 19px; }
  .bar-row { grid-template-columns: 1fr 66px; } .bar-row h4 { grid-column: 1 / -1; }
  .bracket { padding-left: 10px; }
}
@media print {
  body { background: #fff; font-size: 11pt; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  section { border: 0; padding: 0 0 10px; } .card, .cause, .figures > svg, tr {
  break-inside: avoid; } h2, h3 { break-after: avoid; } .scroll { overflow: visible; }
  th, td { white-space: normal; padding-right: 8px; font-size: 9.5pt; }
}
"""

PATTERNS = """<svg class="defs" aria-hidden="true" width="0" height="0"><defs>
<pattern id="dots" width="6" height="6" patternUnits="userSpaceOnUse">
<rect width="6" height="6" fill="#fff"/><circle cx="3" cy="3" r="1.3" fill="#57606a"/></pattern>
<pattern id="lines" width="5" height="5" patternUnits="userSpaceOnUse">
<rect width="5" height="5" fill="#fff"/><rect width="5" height="1.6" fill="#57606a"/></pattern>
<pattern id="effect" width="7" height="7" patternUnits="userSpaceOnUse"
 patternTransform="rotate(45)"><rect width="7" height="7" fill="#f3a56a"/>
<rect width="3" height="7" fill="#a03c00"/></pattern>
<pattern id="effect-2" width="7" height="7" patternUnits="userSpaceOnUse"
 patternTransform="rotate(-45)"><rect width="7" height="7" fill="#fff"/>
<rect width="3" height="7" fill="#a03c00"/></pattern>
</defs></svg>"""
