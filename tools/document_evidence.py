# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of pages filled from the table of evidence, for tools/document.py. A block is between
`<!-- evidence: NAME -->` and `<!-- end of evidence -->`."""

import re
import textwrap
from collections.abc import Callable, Sequence
from math import isnan

from rockfall.evidence import Evidence, error_range, evidence, only

BLOCK = re.compile(r"(<!-- evidence: (\S+) -->\n).*?(<!-- end of evidence -->)", re.DOTALL)
LINES = "EL1", "EL2"
QUANTITIES = {
    "speed": "speed [m/s]",
    "passing_height": "passing height [m]",
    "energy_translational": "energy of translation [kJ]",
}
STATISTICS = {"mean": "mean", "std": "standard deviation", "max": "largest of 100"}
MODELS = {  # names of models at Vaujany on pages
    "talus": "impact table `talus`",
    "rocky-slope": "impact table `rocky-slope`",
    "vaujany-observed": "set `vaujany-observed`, the default",
    "bourrier2009, B": "set `bourrier2009`, method B",
    "bourrier2009, A": "set `bourrier2009`, method A",
    "laboratory-spheres": "set `laboratory-spheres`",
    "paper, B": "the paper's own simulation, B",
    "paper, A": "the paper's own simulation, A",
}
IN_DETAIL = "talus", "vaujany-observed", "paper, B", "paper, A"  # with a column for each quantity
TRIED = "compact", "meadow", "vegetated-soil", "soft-soil", "talus"  # grounds of plains below talus
SIZES = "0.2", "0.5", "1"  # R_b on these plains [m]
SLOPES = 20, 26, 30, 34, 38  # slopes of planes [degree]
SOILS = "vegetated-soil", "soft-soil"  # grounds onto which blocks fall
SMALL = "talus", "soft-soil", "vegetated-soil", "meadow", "compact", "rock"  # with R_b = 0.4 m


def filled(page: str) -> str:
    """Page with updated blocks."""
    return BLOCK.sub(lambda block: f"{block[1]}{BLOCKS[block[2]]()}\n{block[3]}", page)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def bullets(items: Sequence[str]) -> str:
    indents = {"initial_indent": "- ", "subsequent_indent": "  "}
    whole = {"break_on_hyphens": False, "break_long_words": False}
    return "\n".join(textwrap.fill(item, 100, **indents, **whole) for item in items)


def signed(*rows: Evidence) -> str:
    """Signed errors [%] of rows, joined by "and", without standard errors."""
    return " and ".join(f"{round(row.error):+d}".replace("+0", "0") for row in rows) + " %"


def with_error(row: Evidence, decimals: int) -> str:
    """Simulated value with its standard error, if known."""
    number = f"{row.simulated:.{decimals}f}"
    return number if isnan(row.standard_error) else f"{number} ± {row.simulated_error:.1g}"


def signed_with_error(row: Evidence, decimals: int) -> str:
    """Simulated value with its sign and, if known, its standard error."""
    return f"{'+' if row.simulated > 0 else ''}{with_error(row, decimals)}"


def vaujany(model: str, statistic: str) -> str:
    """Range of the signed errors [%] of a statistic, over quantities and lines."""
    low, high = error_range(evidence("vaujany", quantity=f"*_{statistic}", model=model))
    return f"{low:+d} to {high:+d} %".replace("+0", "0")


def high_height(line: str, model: str) -> float:
    """Error [%] of the mean plus one standard deviation of the passing heights at a line."""
    mean, deviation = (
        only("vaujany", line, f"passing_height_{statistic}", model) for statistic in ("mean", "std")
    )
    observed = mean.observed + deviation.observed
    return 100 * ((mean.simulated + deviation.simulated) / observed - 1)


def too(error: float) -> str:
    """Size and direction of an error [%]."""
    return f"{abs(error):.0f} % too {'high' if error > 0 else 'low'}"


def largest_too(quantity: str, model: str) -> str:
    rows = ((line, only("vaujany", line, f"{quantity}_max", model)) for line in LINES)
    return " and ".join(f"{too(row.error)} at {line}" for line, row in rows)


def largest(quantity: str, model: str) -> str:
    return signed(*(only("vaujany", line, f"{quantity}_max", model) for line in LINES))


def pasture(quantity: str, model: str = "meadow") -> Evidence:
    return only("tschamut", "held-out", f"run_out_{quantity}", model)


def forest(case: str, model: str, quantity: str = "passing") -> Evidence:
    return only("vaujany-forest", case, quantity, model)


def runaway(slope: int, radius: str, model: str) -> float:
    place = f"{slope} degrees, R_b {radius} m"
    return only("long-plane", place, "faster_than_observed", model).error


def shadow(radius: str, quantity: str, model: str, slopes: str = "38 on 10") -> float:
    return only("talus-shadow", f"{slopes} degrees, R_b {radius} m", quantity, model).error


def fallen(model: str) -> float:
    """Fraction of boulders that pass 60 m down a slope after a fall onto it."""
    return only("fall", "20 m onto 20 degrees, R_b 0.6 m", "passing_60_m", model).error


def default_directions() -> str:
    """Sentences on the errors of the default set that matter for design, each marked safe or
    unsafe."""
    steep, default = (38, 42), "vaujany-observed"
    fast = (100 * runaway(slope, "1", f"{default}, R_m 0.2 m") for slope in steep)
    narrow = only("vaujany", "EL2", "passing_height_std", default).error
    items = (
        f"**Too fast on long steep slopes: safe.** On 400 m of {steep[0]} and {steep[1]} degrees "
        f"{' and '.join(f'{part:.0f}' for part in fast)} % of the boulders with R_b/R_m = 5 are "
        "faster than any observed ([planes](validation/planes.md)). If that costs too much, "
        "[calibrate on your site](howto/back-analysis.md).",
        f"**Heights vary too little: unsafe.** At EL2 their standard deviation is "
        f"{too(narrow)}, and mean plus one standard deviation {too(high_height('EL2', default))}. "
        f"The largest of 100 is {largest_too('passing_height', default)}. So design the "
        "height of a barrier by the 99 % quantile, not by 95 %.",
        "**Largest speeds and energies: unsafe.** The largest speed of 100 boulders is "
        f"{largest_too('speed', default)}; the largest energy is "
        f"{largest_too('energy_translational', default)}. Design for the upper limit of an "
        "[ensemble](howto/uncertainty.md).",
    )
    return bullets(items)


def summary() -> str:
    default, by_table = "vaujany-observed", "talus"
    within = {name: (vaujany(name, "mean"), vaujany(name, "std")) for name in (default, by_table)}
    far, wide, short = pasture("mean"), pasture("std"), pasture("mean", default)
    passed = [forest("forest", model) for model in (default, by_table)]
    means, deviations = zip(*within.values(), strict=True)
    return table(
        ["compared with", "default set", "impact tables"],
        [
            [
                "100 boulders at two lines on talus",
                f"means {means[0]}, standard deviations {deviations[0]}",
                f"`{by_table}`: means {means[1]}, standard deviations {deviations[1]}",
            ],
            [
                "run-outs on a pasture",
                f"mean {signed(short)}",
                f"`meadow`: mean {signed(far)}, standard deviation {signed(wide)}",
            ],
            [
                f"a forest passed by {passed[0].observed:g} % of the boulders",
                f"{passed[0].simulated:.0f} % pass",
                f"`{by_table}`: {passed[1].simulated:.0f} % pass",
            ],
        ],
    )


def sites() -> str:
    impacts = {row.model: row for row in evidence("meadow-impacts")}
    left = [
        f"{impacts[model].simulated:.2f}"
        for model in ("laboratory of blocks, W/V 0 to 1", "laboratory of blocks, W/V 0", "meadow")
    ]
    bare, wooded = (forest(case, "talus") for case in ("bare", "forest"))
    speeds = signed(*(forest(case, "talus", "speed_mean") for case in ("bare", "forest")))
    passed = "passing_27.5_degrees"
    models = ["talus", *(f"talus above {plain}" for plain in TRIED[:-1])]
    shade = max(shadow(size, passed, model) for size in SIZES for model in models)
    large = max(shadow("1.8", passed, model, "35 on 5") for model in models[1:])
    mean, spread, ks = (pasture(name) for name in ("mean", "std", "ks"))
    rows = [
        [
            "[Tschamut](tschamut.md)",
            "run-outs of 80 blocks on pasture",
            f"mean {signed(mean)}, standard deviation {signed(spread)}, KS {ks.error:.2f}",
            "half calibrates `meadow`; the other half was used too often to confirm it",
        ],
        [
            "[Vaujany](vaujany.md)",
            "speed, height, energy at two lines on talus",
            f"means {vaujany('talus', 'mean')}, standard deviations "
            f"{vaujany('talus', 'std')}, largest energies "
            f"{largest('energy_translational', 'talus')}",
            "`talus` is calibrated on some slopes of the recipe, and tested on others",
        ],
        [
            "[forest at Vaujany](../../../cases/vaujany-forest/README.md)",
            "fraction that passes, speeds",
            f"{bare.simulated:.0f} % pass without forest ({bare.observed:g} %), "
            f"{wooded.simulated:.0f} % with it ({wooded.observed:g} %), speeds {speeds}",
            "used to choose the hit position of stems, and the rest angle of `talus`",
        ],
        [
            "[single stems](stems.md)",
            "energy left by a hit",
            "more than in a discrete element model",
            "nothing fitted",
        ],
        [
            "[six impacts](impacts.md)",
            "energy left, scars",
            f"measured {impacts['meadow'].observed:g}, laboratory {left[0]}; without spin "
            f"laboratory {left[1]}, its table {left[2]}",
            "nothing fitted",
        ],
        [
            "[shadow of talus](shadow.md)",
            "angle passed by boulders below talus",
            f"up to R_b = 1 m, at most {100 * shade:.0f} % pass the limit of 27.5 degrees; "
            f"of 1.8 m, up to {100 * large:.0f} %",
            "nothing fitted",
        ],
        [
            "[Mel de la Niva](../../../cases/mel-de-la-niva/README.md)",
            "deposited blocks",
            "not run",
            "tested with substitute files",
        ],
    ]
    return table(["site", "what", "by impact tables", "evidence"], rows)


def vaujany_models() -> str:
    return table(
        ["by", "means", "standard deviations", "largest energies, EL1 and EL2", "largest heights"],
        [
            [
                name,
                vaujany(model, "mean"),
                vaujany(model, "std"),
                largest("energy_translational", model),
                largest("passing_height", model),
            ]
            for model, name in MODELS.items()
        ],
    )


def vaujany_lines() -> str:
    def cell(row: Evidence) -> str:
        spread = "" if isnan(row.standard_error) else f" ± {row.standard_error:.1f}"
        return f"{row.error:+.1f}{spread}"

    rows = []
    for line in LINES:
        for quantity, label in QUANTITIES.items():
            for statistic, word in STATISTICS.items():
                found = [
                    only("vaujany", line, f"{quantity}_{statistic}", model) for model in IN_DETAIL
                ]
                observed = f"{found[0].observed:g}"
                rows.append([f"{line}, {label}, {word}", observed, *map(cell, found)])
    names = [f"`{name}`" if "paper" not in name else name for name in IN_DETAIL]
    return table(["error [%]", "observed", *names], rows)


def tschamut() -> str:
    mean, spread, ks, *quantiles = map(pasture, ("mean", "std", "ks", "q05", "q50", "q95"))
    azimuth = only("tschamut", "held-out", "azimuth_std", "meadow")
    blocks = [only("tschamut", f"held-out, block {k}", "run_out_mean", "meadow") for k in (1, 2, 4)]
    matrix = pasture("mean", "vaujany-observed")
    distance = pasture("wasserstein")

    def several(rows: Sequence[Evidence]) -> list[str]:
        seen, made = [row.observed for row in rows], [row.simulated for row in rows]
        return [", ".join(f"{number:.0f}" for number in numbers) for numbers in (seen, made)]

    def met(holds: bool) -> str:
        return "met" if holds else "**not met**"

    fall = [row.simulated for row in blocks]
    rows = [
        ["mean", f"{mean.observed:g}", with_error(mean, 0), "within 10 %",
         f"{met(abs(mean.error) <= 10)}: {signed(mean)}"],
        ["KS", "", with_error(ks, 3), "below 0.22", met(ks.error < 0.22)],
        ["mean of blocks 1, 2, 4", *several(blocks), "in their order",
         met(fall == sorted(fall, reverse=True))],
        ["standard deviation", f"{spread.observed:g}", with_error(spread, 1), "", signed(spread)],
        ["5, 50, 95 %", *several(quantiles), "", ""],
        ["Wasserstein distance", "", with_error(distance, 1), "", ""],
        ["azimuth, standard deviation [degree]", f"{azimuth.observed:g}", with_error(azimuth, 1),
         "", ""],
        ["mean by `vaujany-observed`, R_m 0.2 m", f"{matrix.observed:g}", with_error(matrix, 0), "",
         signed(matrix)],
    ]  # fmt: skip
    return table(["", "observed", "`meadow`", "bound", ""], rows)


def runaway_table() -> str:
    rows = [
        [
            f"`{model}`, R_b = {radius} m",
            *(f"{runaway(slope, radius, model):.2f}" for slope in SLOPES),
        ]
        for radius, models in (("0.4", SMALL), ("1", SMALL[:2]))
        for model in models
    ]
    return table(["plane [degree]", *map(str, SLOPES)], rows)


def shadow_table() -> str:
    pairs = [("`talus`", f"`{plain}`", f"talus above {plain}") for plain in TRIED[:-1]]
    pairs += [("`talus`", "`talus`", "talus"), ("`rocky-slope`", "the same", "rocky-slope")]
    pairs += [("matrix, R_m 0.2 m", "the same", "vaujany-observed, R_m 0.2 m")]
    rows = []
    for talus, plain, model in pairs:
        passed = (f"{shadow(size, 'passing_27.5_degrees', model):.3f}" for size in SIZES)
        angles = (f"{shadow(size, 'angle_passed_by_1_percent', model):.1f}" for size in SIZES)
        rows.append([talus, plain, ", ".join(passed), ", ".join(angles)])
    return table(["talus", "plain", "pass 27.5 degrees", "1 % pass"], rows)


def tables() -> str:
    mean, spread, ks = map(pasture, ("mean", "std", "ks"))
    angles = [
        shadow(size, "angle_passed_by_1_percent", f"talus above {plain}")
        for size in SIZES
        for plain in TRIED[:-1]
    ]
    fast = {
        radius: " and ".join(f"{runaway(34, radius, model):.2f}" for model in SMALL[:2])
        for radius in ("0.4", "1")
    }
    own = {
        model: [
            f"{between(f'compact blocks, {model}', f'passing_{key}').error:.2f}"
            for key in ("error", "too_low")
        ]
        for model in ("ploughed", "hard")
    }
    by_table, of_blocks = (
        [f"{fallen(f'{thrown}{soil}'):.2f}" for soil in SOILS] for thrown in ("", "blocks on ")
    )
    rows = [
        [
            "100 boulders at two lines of [Vaujany](validation/field/vaujany.md), on slopes "
            "not used for calibration",
            "`talus`",
            f"means {vaujany('talus', 'mean')}, standard deviations "
            f"{vaujany('talus', 'std')}, largest energies "
            f"{largest('energy_translational', 'talus')}, largest heights "
            f"{largest('passing_height', 'talus')}",
        ],
        [
            "the same",
            "`rocky-slope`",
            f"means {vaujany('rocky-slope', 'mean')}, deviations {vaujany('rocky-slope', 'std')}",
        ],
        [
            "half of the runs of [Tschamut](validation/field/tschamut.md)",
            "`meadow`",
            f"mean run-out {signed(mean)}, deviation {signed(spread)}, KS {ks.error:.2f} (below "
            "0.22 required: **not met**)",
        ],
        [
            "[shadow](validation/field/shadow.md) below talus of 38 degrees, on a slope of 10 "
            "degrees, R_b 0.2 to 1 m",
            "`compact`, `meadow`, soils",
            f"1 % pass {min(angles):.1f} to {max(angles):.1f} degrees; 27.5 is the usual limit",
        ],
        [
            "no boulder was [observed](validation/field/tschamut.md#runaway) faster than 0.8 m/s "
            "per degree",
            "`talus`, `soft-soil`",
            f"fractions on 400 m of 34 degrees {fast['0.4']} (R_b 0.4 m), {fast['1']} (1 m)",
        ],
        [
            "the same",
            "`vegetated-soil`, `meadow`, `compact`, `rock`",
            "**most are faster on long slopes above 30 degrees**",
        ],
        [
            "blocks in the laboratory, after a fall of 20 m onto 20 degrees (R_b 0.6 m)",
            "`vegetated-soil`, `soft-soil`",
            f"pass 60 m: {' and '.join(by_table)}, blocks {' and '.join(of_blocks)}: **too far**, "
            "on the safe side",
        ],
        [
            "tables simulated for [30 grounds](howto/own-ground.md#between-the-simulated-grounds) "
            "between those of the planes, on slopes where about half of the boulders pass",
            "your own",
            f"mean errors of the fraction that passes {own['ploughed'][0]} (`ploughed`) and "
            f"{own['hard'][0]} (`hard`), within the 0.1 required, but on single slopes up to "
            f"{own['ploughed'][1]} and {own['hard'][1]} too low: **not met there**",
        ],
    ]
    return table(["evidence", "ground", "result"], rows)


def between(blocks: str, quantity: str, model: str = "shipped") -> Evidence:
    return only("between-parts", blocks, quantity, model)


def between_parts() -> str:
    """Table of the errors of table planes at places between their parts."""
    grounds = {
        "`ploughed`": "compact blocks, ploughed",
        "`hard`": "compact blocks, hard",
        "both, other shapes": "other shapes",
    }
    rows = []
    for ground, blocks in grounds.items():
        smaller = [
            between(blocks, f"passing_{key}", "smaller relief") for key in ("bias", "too_low")
        ]
        rows.append(
            [
                ground,
                with_error(between(blocks, "passing_error"), 2),
                signed_with_error(between(blocks, "passing_bias"), 2),
                f"{-between(blocks, 'passing_too_low').error:+.2f}",
                signed_with_error(between(blocks, "half_slope_error"), 1),
                f"{between(blocks, 'half_slope_too_steep').error:+.1f}",
                signed_with_error(smaller[0], 2),
                f"{-smaller[1].error:+.2f}",
            ]
        )
    slope, less = "neutral slope [degree]", "relief 2 degrees smaller"
    head = [
        "model", "mean error", "bias", "lowest", slope, "steepest", f"bias, {less}",
        f"lowest, {less}",
    ]  # fmt: skip
    return table(head, rows)


def forest_table() -> str:
    labels = {
        "passing": "boulders that pass [%]",
        "speed_mean": "mean speed [m/s]",
        "speed_max": "maximum speed of 100 boulders [m/s]",
    }
    rows = []
    for quantity, label in labels.items():
        cells = [label]
        for case in ("bare", "forest"):
            found = [forest(case, model, quantity) for model in ("vaujany-observed", "talus")]
            cells += [f"{found[0].observed:g}", *(with_error(row, 1) for row in found)]
        rows.append(cells)
    heads = [
        f"{how} forest: {what}"
        for how in ("without", "with")
        for what in ("experiment", "`vaujany-observed`", "`talus`")
    ]
    return table(["", *heads], rows)


BLOCKS: dict[str, Callable[[], str]] = {
    "summary": summary,
    "default-directions": default_directions,
    "sites": sites,
    "vaujany-models": vaujany_models,
    "vaujany-lines": vaujany_lines,
    "tschamut": tschamut,
    "runaway": runaway_table,
    "shadow": shadow_table,
    "tables": tables,
    "between-parts": between_parts,
    "forest": forest_table,
}
