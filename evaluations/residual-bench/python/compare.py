"""The same selection on the same rows with public tools: `cargo xtask residual-compare`.

SysIdentPy (forward regression by error reduction ratio, size by BIC) and PySINDy (sequentially
thresholded least squares) choose terms from a library of candidates. It holds what `residual` looks for
under the same names: offset, gain, curvature, inertia, drift and ripple of the reel, with Coulomb,
load-dependent Coulomb, viscous and Stribeck friction (fourteen speeds). Each unit is held out once,
selection included. `residual` gets the same rows and a model file with the same
effects, and chooses by holding out one of the three remaining units. Where the own criterion of a tool does not determine
a choice for new units (number of terms, threshold), a second line makes it by holding out units inside the training data.

Every tool chooses and fits on three units and predicts the fourth, four times. Times are of reading,
selecting and fitting for all four, the least of several runs. They exclude the start and the imports of
Python, and include the start of `residual`.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import pysindy
import sysidentpy
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

STANDSTILL = 5.0  # deg/s
RADIUS = 0.010  # m
REEL = 7.0 / 26.0  # turns of the reel in one of the motor
MAX_TERMS = 10
EFFECTS = ["offset", "gain", "quadratic", "coulomb", "load_dependent_coulomb", "viscous", "stribeck",
           "inertia", "drift_time", "periodic_angle"]


def find(root):
    """Gauge records without compensation: (unit, path, delimiter, lines before the rows)."""
    named = re.compile(r"unit(\d+)_torque[\d.]+_comp0(_repeat\d+)?\.csv$")
    original = re.compile(r"motor_(\d+)[/\\]force_gauge_record_\d+_\d+_0_0(_\d+)?\.txt$")
    paths = sorted(p for p in Path(root).rglob("*") if p.suffix in (".csv", ".txt"))
    for pattern, delimiter, skip in ((named, ",", 1), (original, None, 0)):
        out = [(int(m.group(1)), p, delimiter, skip) for p in paths if (m := pattern.search(str(p)))]
        if out:
            return out
    return []


def read(files):
    """Fitted rows: unit, residual of the declared model, and the candidates by name."""
    parts = []
    for unit, path, delimiter, skip in files:
        t, force, command, speed = np.loadtxt(path, delimiter=delimiter, skiprows=skip).T
        moved = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
        parts.append(np.column_stack([np.full_like(t, unit), t - t[0], force, command / RADIUS, speed,
                                      np.gradient(speed, t), np.radians(moved) * REEL]))
    rows = np.vstack(parts)
    rows = rows[np.abs(rows[:, 4]) > STANDSTILL]
    unit, since, force, load, speed, acceleration, reel = rows.T
    sign = np.sign(speed)
    library = {
        "offset": np.ones_like(load), "load": load, "load^2": load**2, "sign": sign, "sign*load": sign * load,
        "speed": speed, "acceleration": acceleration, "time": since,
        "sin(reel)": np.sin(reel), "cos(reel)": np.cos(reel),
        "load*sin(reel)": load * np.sin(reel), "load*cos(reel)": load * np.cos(reel),
    }
    fast = np.quantile(np.abs(speed), 0.98)
    for v in np.geomspace(max(0.01 * fast, 1.5 * STANDSTILL), 0.6 * fast, 14):
        library[f"stribeck({v:.0f})"] = sign * np.exp(-((speed / v) ** 2))
    return unit, force - load, list(library), np.column_stack(list(library.values()))


def least_squares(x, y, terms):
    return np.linalg.lstsq(x[:, terms], y, rcond=None)[0]


def frols(x, y, size=None):
    """Columns by error reduction ratio; their number by BIC, or as given."""
    tool = FROLS(ylag=1, xlag=1, model_type="NFIR", info_criteria="bic", n_info_values=MAX_TERMS,
                 estimator=LeastSquares())
    # It leaves out the first row of y, as models with lags need.
    y = np.concatenate([[0.0], y])[:, None]
    if size is None:
        size = int(np.nanargmin(tool.information_criterion(x, y))) + 1
    return list(tool.error_reduction_ratio(x, y, size)[1])


def sindy(x, y, threshold=0.05):
    """Columns whose coefficient, with columns of unit length, survives the threshold."""
    scale = np.sqrt(np.mean(x**2, axis=0))
    tool = pysindy.STLSQ(threshold=threshold, alpha=1e-6, max_iter=50)
    tool.fit(x / scale, y[:, None])
    return [int(i) for i in np.flatnonzero(np.ravel(tool.coef_))]


def held_out(unit, x, y, select):
    """Root mean square error, each unit predicted by a selection and fit on the others."""
    squares, chosen = 0.0, []
    for u in np.unique(unit):
        train, test = unit != u, unit == u
        terms = select(unit[train], x[train], y[train])
        k = least_squares(x[train], y[train], terms)
        squares += np.sum((y[test] - x[test][:, terms] @ k) ** 2)
        chosen.append(terms)
    return np.sqrt(squares / len(y)), chosen


def inner(tool, choices):
    """A selection whose last choice is made by holding out units inside the training data."""

    def select(unit, x, y):
        errors = [held_out(unit, x, y, lambda _, a, b, c=c: tool(a, b, c))[0] for c in choices]
        return tool(x, y, choices[int(np.argmin(errors))])

    return select


def timed(runs, work):
    best, value = np.inf, None
    for _ in range(runs):
        begin = time.perf_counter()
        value = work()
        best = min(best, time.perf_counter() - begin)
    return best, value


def residual(program, files, folder, runs, material):
    """Error, time, rows and terms of this project's analysis on the same rows.

    Each unit is predicted by the frozen model of an analysis that never saw it. The time is that of
    the analyses; predicting is a run of its own, whose baseline is the error to report.
    """
    original = files[0][2] is None
    models = Path(__file__).resolve().parents[3] / "evaluations" / "measured-rig" / "models"
    text = (models / ("gauge-original.toml" if original else "gauge-moving.toml")).read_text()
    model, test, out = folder / "model.toml", folder / "test.toml", folder / "out"
    model.write_text(text + f"\n[selection]\nmaterial = {material}\nmax_effects = {MAX_TERMS}\n"
                     f"only = {json.dumps(EFFECTS)}\n")

    def call(chosen, by):
        done = subprocess.run([program, "residual", "--data", *[str(f[1]) for f in chosen], "--model", str(by), "--out", str(out)],
                              capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"residual failed:\n{done.stderr}")
        return json.loads((out / "report.json").read_text())

    squares, rows, seconds, terms, names = 0.0, 0, 0.0, [], []
    for u in sorted({f[0] for f in files}):
        best, report = timed(runs, lambda u=u: call([f for f in files if f[0] != u], model))
        seconds += best
        terms.append(sum(len(e["terms"]) for e in report["effects"]))
        names.append([e["name"] for e in report["effects"]])
        frozen = (out / "MODEL.frozen.toml").read_text()
        frozen = re.sub(r"(?m)^by = .*$", 'by = ["file"]', frozen)
        test.write_text(re.sub(r"(?m)^only = .*$", 'only = ["quantisation"]', frozen))
        seen = call([f for f in files if f[0] == u], test)
        squares += seen["baseline"]["heldout_rmse"] ** 2 * seen["rows"]
        rows += seen["rows"]
    everywhere = [n for n in names[0] if all(n in other for other in names)]
    return np.sqrt(squares / rows), seconds, rows, terms, everywhere


def span(counts):
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def data_folder(given):
    roots = [given] if given else [os.environ["FORCE_DATA"]] if os.environ.get("FORCE_DATA") else ["data", "../shared/data"]
    for root in roots:
        if files := find(root):
            return files
    sys.exit("no force gauge records in " + " or ".join(roots)
             + ". `cargo xtask residual-report` says where to get them")


def main():
    arguments = argparse.ArgumentParser(prog="cargo xtask residual-compare", description=__doc__,
                                        formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--forcectl", required=True, help=argparse.SUPPRESS)
    arguments.add_argument("--data", help="folder of the rig's data (else FORCE_DATA, ./data, ../shared/data)")
    arguments.add_argument("--runs", type=int, default=3, help="the least time of so many runs counts (default 3)")
    arguments.add_argument("--markdown", type=Path, help="write the table into this file")
    a = arguments.parse_args()
    warnings.simplefilter("ignore")
    files = data_folder(a.data)
    unit, y, names, x = read(files)
    with tempfile.TemporaryDirectory() as folder:
        analyses = [(material, residual(a.forcectl, files, Path(folder), a.runs, material)) for material in (0.02, 0.002)]
    own = analyses[0][1][1]
    if analyses[0][1][2] != len(y):
        sys.exit(f"not the same rows: {analyses[0][1][2]} and {len(y)}")
    tools = [
        ("SysIdentPy, FROLS, size by BIC", lambda u, p, q: frols(p, q)),
        ("SysIdentPy, FROLS, size by held-out units", inner(frols, range(1, MAX_TERMS + 1))),
        ("PySINDy, STLSQ, threshold 0.05 N", lambda u, p, q: sindy(p, q)),
        ("PySINDy, STLSQ, threshold by held-out units", inner(sindy, np.geomspace(0.005, 0.3, 10))),
    ]
    lines = []
    for name, select in tools:
        def work(select=select):
            units, target, _, library = read(files)
            return held_out(units, library, target, select)

        seconds, (error, chosen) = timed(a.runs, work)
        everywhere = [names[i] for i in range(len(names)) if all(i in c for c in chosen)]
        lines.append((name, error, seconds, span([len(c) for c in chosen]), ", ".join(everywhere)))
    for material, (error, seconds, _, terms, everywhere) in analyses:
        name = f"residual, material from {100 * material:g} %"
        lines.append((name, error, seconds, span(terms), ", ".join(everywhere)))
    declared = float(np.sqrt(np.mean(y**2)))
    table = [f"{len(y)} rows of {len(files)} records, {len(np.unique(unit))} units, one held out at a time; "
             f"{len(names)} candidate terms; declared model {declared:.4g} N. "
             f"SysIdentPy {sysidentpy.__version__}, PySINDy {pysindy.__version__}, least of {a.runs} runs.", "",
             "| tool | held-out RMSE, N | time, s | times residual's | terms | in every fold |", "|---|---|---|---|---|---|"]
    table += [f"| {n} | {e:.4f} | {s:.2f} | {s / own:.2f} | {c} | {w} |" for n, e, s, c, w in lines]
    text = "\n".join(table) + "\n"
    print(text, end="")
    if a.markdown:
        page = (f"# Beside public tools\n\nPrinted by `cargo xtask residual-compare --markdown "
                f"docs/residual/compare.md`.\n\n{text}\n{__doc__.split(chr(10), 2)[2].strip()}\n\n{FAIRNESS}\n")
        a.markdown.write_text(page)


FAIRNESS = """\
`residual` does not add effects that reduce the error by less than 2 %; in the last line the limit is 0.2 %. Its figures are those of the
effects whose names the data support. What else improves the fit is in its report, and not in these figures. The time of `residual`,
on all cores, includes more than this comparison needs. It chooses the Stribeck speed and the order of the ripple continuously. It
compares every gain with 48 decoys of the residual, and every effect with the others in its place. It computes bootstrap intervals,
looks for unexplained structure, and writes its reports. The Python tools get the candidates as finished columns and do not use
groups, so the comparison holds out units around them. They return terms. Several terms may describe one effect or none (a sum of
Stribeck curves is any curve of the speed). They do not name effects, and do not report that the data cannot distinguish them."""

if __name__ == "__main__":
    main()
