#!/usr/bin/env python3
"""Makes the small station the other tests use: calibrated from simulated dark and white recordings, taught from good parts.

    prepare.py PROGRAMS FOLDER
"""
import shutil
import sys

from bench import ROOT, Bench, small_station


def main():
    bench = Bench(sys.argv[1], sys.argv[2])
    shutil.rmtree(bench.folder, ignore_errors=True)
    bench.folder.mkdir(parents=True)
    shutil.copytree(ROOT / "config/scenes", bench.folder / "scenes")
    bench.station.write_text(small_station((ROOT / "config/station.yaml").read_text()))
    dark = bench.simulate(bench.folder / "scenes/dark.yaml", "dark", parts=2)
    white = bench.simulate(bench.folder / "scenes/white.yaml", "white", parts=4)
    report = bench.json("calibrate", "--config", bench.station, "--from", dark, white, "--out", bench.calibration)
    assert abs(report["black_level_dn"] - 60) < 0.3, report
    assert abs(report["gain_dn_per_electron"] / 0.0963 - 1) < 0.1, report
    good = bench.simulate(bench.folder / "scenes/good.yaml", "good", parts=10, seed=100)
    taught = bench.json("teach", "--config", bench.station, "--from", good, "--out", bench.recipe, "--name", "good part")
    assert taught["parts"] == 10 and len(taught["clusters"]) == 2, taught
    print("prepared", bench.folder)


if __name__ == "__main__":
    main()
