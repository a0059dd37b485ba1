"""Repeat the paper's runs by methods A and B, compare the results, and write the report of B.

`./run demo`, or `python cases/vaujany/demo.py [FOLDER]` if rockfall is installed.
"""

import sys
import warnings
from pathlib import Path

import rockfall
from rockfall.analysis.observed.compare import compare
from rockfall.analysis.observed.observations import read_observed
from rockfall.html_report.page import ReportInputs, write_report
from rockfall.io.rasters.dem import read_dem
from rockfall.plots.figures import figures, write_figures
from rockfall.tables.comparison import comparison_text
from rockfall.text.summary import summary

HERE = Path(__file__).parent
CASES = {"A": HERE / "case_A.nml", "B": HERE / "case.nml"}
PAPER = HERE / "paper.csv", HERE / "paper_ks.csv"


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    paper = read_observed(*PAPER)
    results = {}
    for method, case in CASES.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the summary includes them
            results[method] = rockfall.run(rockfall.read_case(case), progress=True)
        rockfall.write_result(results[method], folder / f"method_{method}.nc")
    for result in results.values():
        print(f"\n{summary(result)}\n\n{comparison_text(compare(result, paper))}")
    if results["A"]["stop_x"].equals(results["B"]["stop_x"]):
        print("A and B coincide: the impact set is the same for all ratios R_b/R_m (see README.md)")

    terrain = read_dem(HERE / "dem.tif")
    for method, result in results.items():
        write_figures(figures(result, terrain, paper), folder / f"figures_{method}")
    write_report(ReportInputs(results["B"], terrain, paper), folder / "report.html")
    print(f"\nResults, figures and report.html: {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1] / "out" / "vaujany")
