"""The style sheet of report.html; a module, so that it needs no care when the package is installed."""

CSS = """
:root { color-scheme: light; --ink: #26241f; --faint: #7d786f; --line: #e4e0d8; --accent: #b3672b; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1180px; padding: 40px 28px 64px; background: #faf9f6; color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", "Helvetica Neue", Arial, "Noto Sans", sans-serif; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .4rem; letter-spacing: -.01em; }
h2 { font-size: 1.1rem; margin: 2.2rem 0 .7rem; }
small, dd, em { color: var(--faint); }
.lead { font-size: 1.15rem; max-width: 62em; margin: 0 0 1.4rem; }
.renders { display: grid; grid-template-columns: repeat(auto-fit, minmax(240px, 1fr)); gap: 14px; }
img { display: block; width: 100%; height: auto; border-radius: 6px; }
.confidence { margin: 1.2rem 0; }
.confidence .bar { width: 110px; margin: 0 .6rem; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr)); gap: 0 48px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; font-weight: normal; padding: .38rem .8rem .38rem 0; border-bottom: 1px solid var(--line);
  vertical-align: baseline; }
th { white-space: nowrap; }
td { width: 99%; }
.parameters td:nth-child(2), .seconds td:nth-child(2) { width: 1%; white-space: nowrap; }
.range { display: flex; align-items: center; gap: .5rem; }
.range small:first-child { width: 2em; text-align: right; }
.range .bar { flex: 1; }
.bar { position: relative; display: inline-block; height: 7px; min-width: 60px; border-radius: 4px;
  background: #e7e2d8; overflow: hidden;
  vertical-align: middle; }
td > .bar { width: 100%; }
.bar i { display: block; height: 100%; background: var(--accent); border-radius: 4px; }
.bar u { position: absolute; top: 0; height: 100%; background: #2b2823; opacity: .35; min-width: 2px; }
.group th { padding-top: 1rem; color: var(--faint); text-transform: capitalize; }
.idle { color: var(--faint); }
.chosen, .other { display: inline-block; padding: 0 .5em; border-radius: 4px; }
.chosen { background: var(--accent); color: #fff; }
.other { color: var(--faint); }
.warnings { background: #fdf1dc; border-left: 4px solid #d9962b; border-radius: 4px; padding: .8rem 1.2rem; }
.warnings h2 { margin: 0 0 .3rem; }
.warnings ul { margin: 0; padding-left: 1.2em; }
.fine { color: #26824a; }
.files { margin: 0; }
.files dt { font-weight: 600; }
.files dd { margin: 0 0 .5rem; }
a { color: inherit; text-decoration-color: var(--accent); text-underline-offset: 3px; }
.legend span { margin-right: 1.6rem; color: var(--faint); white-space: nowrap; }
.legend i { display: inline-block; width: 26px; height: 4px; border-radius: 2px; margin-right: .5rem;
  vertical-align: middle; }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(250px, 1fr)); gap: 18px 14px; }
figure { margin: 0; }
figcaption { display: flex; flex-wrap: wrap; justify-content: space-between; gap: 0 .8rem; font-size: .9rem;
  margin-top: .3rem; }
figcaption span { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; max-width: 75%; }
figcaption em { flex-basis: 100%; }
.unused img { outline: 3px solid #c83c32; outline-offset: -3px; }
@media print { body { max-width: none; padding: 0; } figure { break-inside: avoid; } }
"""
