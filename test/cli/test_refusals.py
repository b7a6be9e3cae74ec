"""Commands on bags that cannot do what is asked: one line, an exit code, nothing left behind."""

import os

import pytest
from altered_bags import altered, numbered
from sample_bags import write_bag, write_offline_bag
from support import extended

from rpud_sim.simulation import preset

EXPECT = "reacting_force.force < 1 kN"
SEQUENCE = 36  # place of the sequence in a contact force [bytes]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with bags of a drill, a bag of no drill, and what is no bag."""
    folder = tmp_path_factory.mktemp("bags")
    write_offline_bag(folder / "drill", preset("drilling"), 0.2, 0.4)
    write_bag(folder / "talk")
    altered(folder / "drill", folder / "no_journal", lambda m: [m.data], {"/rpud/wrench"})

    def change(message):
        return [message.data[:SEQUENCE] + b"\xff" * 8 + message.data[SEQUENCE + 8 :]]

    altered(folder / "drill", folder / "odd", numbered("contact_force", 2, change))
    (folder / "notes.mcap").write_text("no bag at all, and nothing like it")
    os.mkfifo(folder / "fifo")
    (folder / "taken").mkdir()
    (folder / "begun.part").mkdir()
    for name, expectation in (
        ("light", EXPECT),
        ("energy", "contact_force.energy < 1 J"),
        ("topic", "reacting_forc.force < 1 N"),
        ("kind", "{onset: choked}"),
        ("unit", "reacting_force.force < 1 s"),
    ):
        text = f"expectations:\n- {{name: a, expect: {expectation}}}\n"
        (folder / f"{name}.yaml").write_text(text)
    return folder


EXPORT = "export talk --out out"
REBUILD = "export drill --out out"
COMPARE = "compare drill drill"
TAKEN = "exists already; --force replaces it"


@pytest.mark.parametrize(
    ("call", "code", "reason"),
    [
        (f"{EXPORT} --start nan", 2, "--start = nan s is outside its range [0, 1e+09] s"),
        (f"{EXPORT} --duration 0", 2, "--duration = 0 s is outside its range [1e-09, 1e+09] s"),
        (f"{EXPORT} --format xls", 2, "argument --format: invalid choice: 'xls'"),
        (f"{EXPORT} --start 1", 2, "--start = 1 s is not in the 0.009 s that the bag holds"),
        (
            f"{EXPORT} --topics /rpud/tlak",
            1,
            "talk holds no topic '/rpud/tlak'; did you mean /rpud/talk?",
        ),
        (f"{EXPORT} --run 2", 2, "--run goes with --rate"),
        ("export talk --out taken", 1, f"taken {TAKEN}"),
        ("export none --out out", 1, "there is no bag at none"),
        (f"{REBUILD} --rate 0", 2, "--rate = 0 Hz is outside its range [1, 1e+09] Hz"),
        (f"{REBUILD} --rate 1.5", 2, "--rate = 1.5 Hz is not a whole number"),
        (f"{REBUILD} --rate 10 --run 2", 2, "--run = 2 is outside its range [1, 1]: resets begin"),
        extended(f"{REBUILD} --rate 10 --start 5", 2, "--start = 5 s is not in the 0."),
        (f"{REBUILD} --rate 10 --topics /a", 1, "drill holds no trajectory named /a; "),
        ("recover none --out out", 1, "there is no bag at none"),
        ("recover talk --out taken", 1, f"taken {TAKEN}"),
        ("recover notes.mcap --out out", 1, "notes.mcap has no part of an MCAP file"),
        ("report talk --out notes.mcap", 1, f"notes.mcap {TAKEN}"),
        ("report talk --out taken --force", 1, "taken is not a folder of rpud"),
        ("report talk --namespace /b", 2, "talk holds no drill in '/b'; valid ones are /rpud"),
        ("verify no_journal", 1, "no_journal holds no journal; record the topic journal, or all"),
        ("verify", 2, "the following arguments are required: BAG"),
        ("test none --expect light.yaml", 1, "there is no bag at none"),
        ("test none --expect topic.yaml", 2, "topic.yaml:2: "),
        ("test none --expect kind.yaml", 2, "kind.yaml:2: fault kind = 'choked' is unknown"),
        ("test none --expect unit.yaml", 2, "unit.yaml:2: "),
        ("test odd --expect energy.yaml", 1, "contact_force: sequence: a number is too large"),
        ("test drill", 2, "a bag needs --expect FILE; see rpud test --help"),
        ("test drill --expect light.yaml --lf", 2, "unrecognized arguments: --lf"),
        ("fork drill --at 0.1", 2, "no destination: use --out DIR or --live"),
        ("fork drill --at nan --out x", 2, "--at = nan s is outside its range"),
        ("fork drill --at 0.3 --out x", 2, "0.3 s is outside run 1 of 1 of the bag: [0, 0.2] s"),
        ("fork drill --at 0.2 --out x", 1, "nothing is left of the recorded run after --at = 0.2"),
        ("fork drill --at 0.1 --run 2 --out x", 2, "--run = 2 is outside its range [1, 1]"),
        ("fork drill --at 0.1 --set gravty=1 --out x", 2, "did you mean gravity"),
        ("fork drill --at 0.1 --set gravity=-1 --out x", 2, "gravity = -1 m/s^2 is outside"),
        ("fork drill --at 0.1 --inject jammed --out x", 2, "free_mass_jammed"),
        ("fork drill --at 0.1 --commands none.yaml --out x", 2, "none.yaml"),
        ("fork drill --at 0.1 --quiet --out x", 2, "--namespace and --quiet go with --live"),
        ("fork drill --at 0.1 --live --json", 2, "--json goes with a bag, not with --live"),
        ("fork drill --at 0.1 --set publish_clock=true --out x", 2, "publish_clock cannot"),
        ("fork drill --at 0.1 --out taken", 1, "taken exists already"),
        ("fork talk --at 0.1 --out x", 1, "holds no journal; record the topic journal"),
        ("simulate --repeat 0", 2, "--repeat = 0 is outside its range [1, 1e+06]"),
        ("simulate --set weight_on_bit=-5", 2, "weight_on_bit = -5 N is outside its range [0, 1"),
        ("simulate --set oops", 2, "'oops' is not of the form name=value"),
        ("simulate --set telemetry_rate=10", 2, "a parameter of the drill node alone: see rpud r"),
        ("simulate --bag x --repeat 2", 2, "--bag goes with a single run, not with --repeat"),
        ("replay none", 1, "there is no bag at none"),
        ("replay notes.mcap", 1, "notes.mcap is not an MCAP file"),
        ("replay talk --remap /rpud/none:=/b", 1, "--remap names /rpud/none, "),
        ("replay talk --exclude /rpud/none", 1, "--exclude names /rpud/none"),
        ("replay talk --remap talk:=/b", 2, "'talk:=/b' is not of the form OLD:=NEW with two abs"),
        ("replay talk --remap /a:=/b /c", 2, "'/c' is not of the form OLD:=NEW"),
        ("replay talk --start 2.5", 2, "--start is 2.5 s; it must be from 0 to 0.009 s"),
        ("export talk --topic /rpud/tlak --out x", 1, "tlak'; did you mean /rpud/talk?"),
        ("export talk --topic tallk --out x", 1, "tallk'; did you mean /rpud/talk?"),
        ("info fifo", 1, "fifo is neither a folder nor a regular file\n"),
        ("sweep --points fifo", 2, "fifo: is not a regular file\n"),
        ("sweep --points none.csv", 2, "none.csv: No such file or directory\n"),
        ("info note.mcap", 1, "there is no bag at note.mcap; did you mean notes.mcap?"),
        ("simulate --config notes.mca --duration 1", 2, "directory; did you mean notes.mcap?"),
        ("replay talk --topics /rpud/tlak", 1, "which talk lacks; did you mean /rpud/talk?"),
        ("record --out x --regex (", 2, "argument --regex: '(' is not a valid regular expression"),
        ("run --record x --set weight_on_bit=-1", 2, "weight_on_bit = -1 N is outside its range"),
        ("run --record x --config /no.yaml", 2, "/no.yaml: No such file or directory"),
        ("run --record x --namespace a?b", 2, "Invalid namespace: namespace must not contain"),
        (f"{COMPARE} --tolerance 0", 2, "--tolerance = 0 % is outside its range (0, 100) %"),
        (f"{COMPARE} --quantity peakforce", 2, "peakforce is not a quantity; did you mean peak"),
        (f"{COMPARE} --from 2 --to 1", 2, "--to = 1 s is not after --from = 2 s"),
        ("simulate --set seed=-5 --duration 1", 2, "simulate: seed = -5 is outside its range"),
        (f"{COMPARE} --run 1 --run 1 --run 1", 2, "3 choices of a run for 2 bags: give 1 or 2"),
        (f"{COMPARE} --from 50", 1, "the runs have no time in common from 50 s to the end: "),
        ("compare drill talk", 1, "talk holds no topic of a drill"),
        (f"{COMPARE} --out no/x.html", 1, "no/x.html: there is no folder no"),
        (f"{COMPARE} --out notes.mcap", 1, f"notes.mcap {TAKEN}"),
    ],
)
def test_it_is_one_line_and_nothing_is_left(folder, rpud, monkeypatch, call, code, reason):
    monkeypatch.chdir(folder)
    before = sorted(os.listdir())
    command, *words = call.split()
    found, out, err = rpud(command, *words)
    assert (found, out) == (code, "")
    assert err.startswith(f"rpud {command}: ")
    assert reason.format(folder=folder) in err
    assert err.count("\n") == 1
    assert sorted(os.listdir()) == before
