"""Runs checks over random scenes in worker processes, prints the table, proves that planted mistakes are found."""

import importlib
import os
import pkgutil
import shlex
import shutil
import sys
import time
import tomllib
import traceback
from concurrent.futures import ProcessPoolExecutor

from . import checks, harness
from .reference import random_scenes
from .reference.scene import parse

# How many scenes --prove tries for a quantity before it says that a planted mistake is not found.
PROOF_SCENES = 12


def registry(part=None):
    """The checks' modules by name: all in `checks/` that have `QUANTITIES`."""
    names = sorted(module.name for module in pkgutil.iter_modules(checks.__path__))
    modules = {name: importlib.import_module(f"{checks.__name__}.{name}") for name in names}
    modules = {name: module for name, module in modules.items() if hasattr(module, "QUANTITIES")}
    if part:
        wanted = part.split(",")
        unknown = [name for name in wanted if name not in modules]
        if unknown:
            raise SystemExit(f"no check {', '.join(unknown)}; there are {', '.join(modules)}")
        modules = {name: modules[name] for name in wanted}
    return modules


def list_quantities(module, with_firmware=True):
    """What a check compares; some of it needs a firmware image (`--elf`)."""
    return (*module.QUANTITIES, *(getattr(module, "WITH_FIRMWARE", ()) if with_firmware else ()))


def due(module, index):
    """Whether a check runs on the scene of this index: dear ones say every how many, `EVERY` (1), and from which, `FIRST` (0)."""
    every = getattr(module, "EVERY", 1)
    return index % every == getattr(module, "FIRST", 0) % every


def _context(options, index, plant):
    if options.scene:
        text = options.scene.read_text(encoding="utf-8")
        table = tomllib.loads(text)
    else:
        table = random_scenes.make(options.seed, index)
        text = random_scenes.to_toml(table)
    folder = options.work.resolve() / f"{options.seed}-{index}{'-planted-' + plant if plant else ''}".replace(" ", "_").replace("/", "_")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    program = harness.Program(str(options.era), folder / "scene.toml", folder)
    return harness.Context(index, options.seed, f"{options.seed}-{index}", parse(text), table, program, folder, plant, options.elf, options.scene is not None)


def _planter(plant):
    """What a quantity's check plants: a function of the scene's table, or None if the check alters the answer itself."""
    for module in registry().values():
        if plant in list_quantities(module):
            planted = module.PLANTS[plant]
            return None if planted == "answer" else planted
    raise SystemExit(f"no quantity {plant!r}")


def _processor_s():
    """Seconds of processor time that this process and the programs that it has run took."""
    return sum(os.times()[:4])


def one_scene(options, index, plant=None, everywhere=False):
    """All checks on one scene: results, and processor seconds of each check. Runs in a worker."""
    context = _context(options, index, plant)
    if plant and (planter := _planter(plant)):
        text = harness.planted_text(context.table, planter)
        if text is None:
            shutil.rmtree(context.folder, ignore_errors=True)
            return index, [], {}
        (context.folder / "planted.toml").write_text(text, encoding="utf-8")
        context.era.scene_path = context.folder / "planted.toml"
    results, seconds = [], {}
    for name, module in registry(options.part).items():
        if not everywhere and not due(module, index):
            continue
        if plant and plant not in list_quantities(module):
            continue
        started = _processor_s()
        try:
            found = module.run(context)
        except harness.ProgramFailed as failure:
            found = [harness.Result(f"{name}: program", context.name, float("inf"), 0.0, True, str(failure))]
        except Exception:  # A mistake of the check is a failure of the run, not the end of it.
            found = [harness.Result(f"{name}: check", context.name, float("inf"), 0.0, True, traceback.format_exc())]
        for result in found:
            result.part = name
        results += found
        seconds[name] = _processor_s() - started
    if not any(result.failed for result in results):
        shutil.rmtree(context.folder, ignore_errors=True)
    return index, results, seconds


def run(options):
    """Compares and prints the table. 0 if nothing failed."""
    started = time.perf_counter()
    modules = registry(options.part)
    indices = [options.only] if options.only is not None else range(options.first, options.scenes)
    everywhere = options.only is not None or options.plant is not None or options.scene is not None
    results, seconds = [], dict.fromkeys(modules, 0.0)
    with ProcessPoolExecutor(options.jobs) as pool:
        tasks = [pool.submit(one_scene, options, index, options.plant, everywhere) for index in indices]
        for done, task in enumerate(tasks, 1):
            index, found, spent = task.result()
            results += found
            for name, value in spent.items():
                seconds[name] += value
            if options.verbose:
                print(f"  scene {index}: " + ", ".join(f"{name} {value:.1f} s" for name, value in spent.items()), flush=True)
            for result in found:
                if result.failed or options.verbose:
                    verdict = "FAILED" if result.failed else "holds" if result.comparable else "not comparable"
                    print(f"  {result.scene} {result.quantity}: {verdict}, {result.difference:.3g} of {result.bound:.3g} {result.note}", flush=True)
            if sys.stderr.isatty() and not options.verbose:
                print(f"\r{done} of {len(tasks)} scenes", end="", file=sys.stderr, flush=True)
    print_table(results)
    minutes = (time.perf_counter() - started) / 60
    print(f"\n{len(tasks)} scenes of seed {options.seed}, {minutes:.1f} min; processor seconds of each check: "
          + ", ".join(f"{name} {value:.0f}" for name, value in seconds.items()))
    failures = [result for result in results if result.failed]
    if failures:
        print(f"\n{len(failures)} failures; each again with:")
        for line in sorted({_command(options, result) for result in failures}):
            print(f"  {line}")
    elif not results:
        print("nothing was compared")
    return 1 if failures or not results else 0


def _command(options, result):
    index = result.scene.split("-")[1]
    words = ["cargo", "xtask", "crosscheck", "--seed", str(options.seed), "--only", index]
    words += ["--scene", str(options.scene)] if options.scene else []
    words += ["--emulated"] if options.elf else []
    return shlex.join([*words, "--part", result.part] + (["--plant", options.plant] if options.plant else []))


def print_table(results):
    """Quantity, cases, worst difference, worst in units of its bound, not comparable, failures."""
    print(f"\n| {'quantity':<34} | cases | worst difference | of its bound | not comparable | failures |")
    print(f"|{'-' * 36}|-------|------------------|--------------|----------------|----------|")
    for quantity in sorted({result.quantity for result in results}):
        own = [result for result in results if result.quantity == quantity]
        counted = [result for result in own if result.comparable]
        difference = max((result.difference for result in counted), default=0.0)
        ratio = max((result.ratio for result in counted), default=0.0)
        failures = sum(result.failed for result in own)
        print(f"| {quantity:<34} | {len(counted):>5} | {difference:>16.2e} | {ratio:>12.3g} | {len(own) - len(counted):>14} | {failures:>8} |")


def prove(options):
    """Plants a mistake in each quantity and looks for it. 0 if every one is found."""
    started = time.perf_counter()
    modules = registry(options.part)
    quantities = [quantity for module in modules.values() for quantity in list_quantities(module, options.elf is not None)]
    missed = []
    print(f"| {'planted in':<34} | found in scene | difference | of its bound |")
    print(f"|{'-' * 36}|----------------|------------|--------------|")
    with ProcessPoolExecutor(options.jobs) as pool:
        for quantity, found in zip(quantities, pool.map(_prove_one, [options] * len(quantities), quantities)):
            if found is None:
                missed.append(quantity)
                print(f"| {quantity:<34} | not found      |            |              |", flush=True)
            else:
                print(f"| {quantity:<34} | {found.scene:<14} | {found.difference:>10.2e} | {found.ratio:>12.3g} |", flush=True)
    print(f"\n{len(quantities)} quantities, {(time.perf_counter() - started) / 60:.1f} min")
    if missed:
        print(f"planted and not found: {', '.join(missed)}")
    return 1 if missed else 0


def _prove_one(options, quantity):
    """The result that finds a mistake planted in `quantity`, or None."""
    for index in range(PROOF_SCENES):
        _, results, _ = one_scene(options, index, quantity, True)
        for result in results:
            if result.failed and result.quantity == quantity:
                shutil.rmtree(options.work.resolve() / f"{options.seed}-{index}-planted-{quantity}".replace(" ", "_").replace("/", "_"), ignore_errors=True)
                return result
    return None
