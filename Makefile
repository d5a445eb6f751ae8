# Everything runs in .venv; nothing else is installed by hand. Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint demo-check machines year-study rig-study outliers withheld independent other-simulator structures fit-verdict emergent gapbench compare-study fleet bench host-rows joint-covariance single-drives quiet-machines faults kill-sweep watch-events deliberate-errors mutants peers latency overhead panel panel-stops panel-guide setups control-formats two-processes bad-cases kuka papers clean

# MACHINE=stewart6 for another shipped machine.
demo: $(VENV)/run.stamp
	$(BIN)/pkm-rig demo $(if $(MACHINE),--machine $(MACHINE))

# Four workers on two cores: many tests wait for an answer that does not come, or for a deadline, and use no core meanwhile.
# What one of them has compiled of the tests the others read, even where the environment forbids to keep it.
test: $(VENV)/dev.stamp
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 4

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Every fault at every operation of a short campaign, one table; ends after an hour and goes on where it was ended.
faults: $(VENV)/dev.stamp
	$(BIN)/python -m tests.faults.sweep $(FAULTS)

# Host, mock devices and single drives killed in short campaigns that are then taken up again; devices that fall silent.
# Stopped, it goes on. CHAINS=2 for a first look, ONLY=silent for the devices that fall silent.
kill-sweep: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.kill_sweep.run $(if $(CHAINS),--chains $(CHAINS)) $(if $(ONLY),--only $(ONLY))

# What `recalibrate watch` does, over the wire, when something happens to the machine, its devices, papers or computer, and
# which tables act then (docs/explanation/watch-events.md). Stopped, it goes on. ONLY="drive replaced" for one event.
watch-events: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.watch_events.run $(if $(ONLY),--only "$(ONLY)")

# Errors that somebody might make (tests/deliberate_errors/errors.toml), each in a copy of the tree: the tests must find it.
# Stopped, it goes on.
deliberate-errors: $(VENV)/dev.stamp
	$(BIN)/python -m tests.deliberate_errors.run $(if $(ONLY),--only "$(ONLY)")

# A seeded sample of 300 mutants over drivers, diagnosis and identification, each against its room's tests. Stopped, it
# goes on. NUMBER=20 for a first look, SURVIVORS=1 to try survivors again after tests were added.
mutants: $(VENV)/dev.stamp
	$(BIN)/python -m tests.mutants.run $(if $(NUMBER),--number $(NUMBER)) $(if $(SURVIVORS),--survivors)

# Mocks and drivers against other people's programs; says which could not be had.
peers: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.peers.run

# From a bit in the PLC to the last drive's stop frame; what the software itself costs. In real time, for minutes.
latency: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.stop_latency

overhead: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.overhead --real-time

# What the page costs beside the same work without it, and how soon it shows what has changed, one table; needs Chromium.
# A quarter of an hour in real time.
panel: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.panel

# Stops without and with a page, in pairs, until it can be said whether a page makes them slower; needs Chromium. Half an
# hour in real time on a quiet computer; stopped, it goes on, PAIRS=50 adds to what is there.
panel-stops: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.panel_stops $(if $(PAIRS),--pairs $(PAIRS))

# From an empty folder to an accepted calibration of the mock rig by the page alone, at 390 and 1280 px; screens in
# runs/panel-screens. Needs Chromium.
panel-guide: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.panel_guide

# Twenty mock machines, each scored against the plant's own noise-free positions. SEEDS=1,2 for some of them.
# MACHINE=gough8: ten of another machine; stopped, that goes on.
demo-check: $(VENV)/run.stamp
	$(BIN)/python $(if $(MACHINE),-m benchmarks.machine_check $(MACHINE),-m benchmarks.demo_check) \
		$(if $(SEEDS),--seeds $(SEEDS))

# Mock and calibration in two processes, over a pseudo-terminal, socketcand and TCP, against one process: the same
# parameters, and equal ones without drift and warmth. In the rig's own time, for hours, on cores that answer every SYNC in
# time: raise both processes' priority (chrt -f 20) where others work beside them. SCALE=2 for twice as fast; MACHINE=planar4
# SCALE=10, which is not led by SYNC. POSES=12 JOB=measure for a first look of half an hour. Stopped, it goes on.
two-processes: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.two_processes $(or $(MACHINE),gough8) $(if $(SCALE),--scale $(SCALE)) \
		$(if $(POSES),--poses $(POSES)) $(if $(JOB),--job $(JOB))

# Campaigns in which somebody has made a mistake, straight from the mock plant: none may end with tables that are worse than
# none (docs/explanation/mistakes.md). EACH=5 of each kind and GOOD=20 for a first look; WIRE=5 of each kind over the real
# protocols. Stopped, it goes on.
bad-cases: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.bad_cases.run $(if $(EACH),--each $(EACH)) $(if $(GOOD),--good $(GOOD)) \
		$(if $(WIRE),--wire $(WIRE))

# The shipped machines beside one another: motion, correction, noise floors, and what each command does with them.
machines: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.machines

# Three set-ups of the station against one, twenty mock machines, scored by the plant. SEEDS=1,2 for some of them.
# Stopped, it goes on.
setups: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.setups $(if $(SEEDS),--seeds $(SEEDS))

# Reports, PDF and certificates of five campaigns: every number, every box of text. SCHEMAS=DIR with PTB's schema files.
# Stopped, it goes on; pages are drawn below runs/papers.
papers: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.papers $(if $(SCHEMAS),--schemas $(SCHEMAS))

# What formats of controls lose of the correction, on the nine machines, and Siemens CEC on twenty default ones
# (docs/explanation/control-tables.md). Stopped, it goes on. SEEDS=5 for a first look.
control-formats: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.control_formats $(if $(SEEDS),--seeds $(SEEDS))

# Random rigs of two machines, every estimator against the noise-free truth (docs/explanation/rig-study.md).
# Stopped, it goes on. RIGS=20 for a first look, PROCESSES=4; the picture of docs/ is drawn from all rigs only.
rig-study: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.rig_study $(if $(PROCESSES),--processes $(PROCESSES)) \
		$(if $(RIGS),--rigs $(RIGS),--picture docs/images/estimators.png)

# Simulated machine-years: when calibration is due by the project's rules, by charts, calendar and staircase, one table
# (docs/explanation/year-study.md). Stopped, it goes on. YEARS=20 for a first look, PROCESSES=4; the picture of docs/ is
# drawn from a whole study only. DEVELOPMENT=1 takes other seeds, to set limits with.
year-study: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.year_study.run $(if $(PROCESSES),--processes $(PROCESSES)) \
		$(if $(DEVELOPMENT),--development --out runs/year-study-development) \
		$(if $(YEARS),--years $(YEARS) --steps $(YEARS) --ramps $(YEARS) --lost $(YEARS),--picture docs/images/year-study-power.png)

# Wrong readings planted into recordings of the mock plant, one table (docs/explanation/wrong-readings.md). Stopped, it
# goes on; SEEDS=20 for a first look.
outliers: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.outliers $(if $(SEEDS),--seeds $(SEEDS))

# The diagnosis on withheld cases, sealed (docs/explanation/withheld.md): seed of the operating system, final variants,
# one line in the committed log. N=60 for a first look; SEED=1 is for development: no final variants, no log; WHOLE=1 leaves
# no forms out of the catalogue. Stopped, it goes on.
withheld: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.withheld.run $(if $(SEED),--seed $(SEED),--final) $(if $(N),--n $(N)) \
		$(if $(WHOLE),--no-leave-form-out)

# The diagnosis on recordings of another simulator (docs/explanation/independent.md), if they lie in
# ../shared/independent or DATA=FOLDER: even numbers, with a list of the misjudged. N=10 for a first look; GROSS=1 plants
# gross readings too, FAR=1 many that are far off. FINAL=1 scores the odd ones: at most five times ever, each a line in the committed log. Stopped, it
# goes on.
independent: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.independent.run $(if $(DATA),--data $(DATA)) $(if $(N),--n $(N)) \
		$(if $(GROSS),--gross) $(if $(FAR),--far) $(if $(FINAL),--final)

# The diagnosis on a second simulator of campaigns (docs/explanation/other-simulator.md): makes ARCHIVE=first,
# second, third, fourth, fifth, sixth, seventh, eighth, ninth, tenth or space in OUT (runs/other-simulator/ARCHIVE), then checks it as `independent`;
# answers lie in it. Of `tenth` and `space` it does not say what was misjudged. N=10 for the first ten recordings. Stopped, it goes on.
other-simulator: OUT ?= runs/other-simulator/$(ARCHIVE)
other-simulator: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.other_simulator --archive "$(ARCHIVE)" --out "$(OUT)" $(if $(N),--n $(N))
	$(BIN)/python -m benchmarks.independent.run --data "$(OUT)" --out "$(OUT)/answers" \
		$(if $(filter tenth space,$(ARCHIVE)),--totals)

# The diagnosis on structures without a named formula (docs/explanation/structures.md): N cases (100), SEED (1). Stopped, it
# goes on; a larger N adds cases.
structures: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.structures.run $(if $(N),--n $(N)) $(if $(SEED),--seed $(SEED))

# Constants of the diagnosis' verdict, fitted crosswise on cases that the figures to be judged are not made of
# (docs/explanation/verdict-constants.md): N cases (100) of each of three sources, half an hour for a hundred. GRID=1
# diagnoses them at four more sizes of departures. Prints; changes nothing. Stopped, it goes on; a larger N adds cases.
fit-verdict: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.fit_verdict.run $(if $(N),--n $(N)) $(if $(GRID),--grid) $(if $(WRITE),--write) $(if $(DATA),--data $(DATA))

# Programs beside one another on recordings whose cause is known (docs/how-to/enter-gapbench.md): ours, greedy BIC, a
# classifier of scikit-learn that is trained first, and PROGRAM="NAME=COMMAND {folder}". SEED=1; N=10 cases of drawn
# structure for a first look. Stopped, it goes on.
gapbench: $(VENV)/gapbench.stamp
	$(BIN)/python -m benchmarks.gapbench.run $(if $(N),--structures $(N)) $(if $(SEED),--seed $(SEED)) \
		$(if $(PROGRAM),--program "$(PROGRAM)")

# The diagnosis on a plant in MuJoCo in which errors emerge (docs/explanation/emergent.md): 200 cases, an hour or two on two
# cores. N=20 for a first look, SEED=1 for others, PROCESSES=4. What is scored with which catalogue is a line in the log. Stopped, it goes on.
emergent: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.emergent.run $(if $(N),--n $(N)) $(if $(SEED),--seed $(SEED)) $(if $(PROCESSES),--processes $(PROCESSES))

# What changed between two campaigns, on 1,000 pairs whose change is known (docs/explanation/comparison.md): about an hour on
# two free cores. N=50 for a first look; SEED=1 is for development; TABLE=1 prints what is there. Stopped, it goes on.
compare-study: $(VENV)/dev.stamp
	nice -n 10 $(BIN)/python -m benchmarks.comparison.run $(if $(N),--n $(N)) $(if $(SEED),--seed $(SEED)) \
		$(if $(PROCESSES),--processes $(PROCESSES)) $(if $(TABLE),--table)

# Headers of 10,000 stored campaigns listed and charted; 40 campaigns diagnosed by two Dask workers of this computer and in
# one process, whose results must be equal (docs/how-to/work-on-many-campaigns.md). Stopped, it goes on. CAMPAIGNS=500
# DIAGNOSED=2 for a first look; PART=lists or cluster for one of them.
fleet: $(VENV)/dev.stamp
	nice -n 10 $(BIN)/python -m benchmarks.fleet $(if $(CAMPAIGNS),--campaigns $(CAMPAIGNS)) \
		$(if $(DIAGNOSED),--diagnosed $(DIAGNOSED)) $(if $(PART),--part $(PART))

# The diagnosis of one drive alone on six measured recordings of a robot (docs/explanation/axis.md), if they lie in
# ../shared/real-data/kuka-kr300 or DATA=FOLDER. Stopped, it begins anew: it takes one or two minutes.
kuka: $(VENV)/run.stamp
	$(BIN)/python -m benchmarks.real_axis $(if $(DATA),--data $(DATA))

# Speed beside scipy, MuJoCo, pinocchio and FIGAROH's solver (docs/explanation/benchmarks.md). QUICK=1 for a check
# that it runs.
# Both are run whatever becomes of the first; the status tells of goals that were missed.
bench: $(VENV)/bench.stamp
	$(BIN)/python -m benchmarks.forward $(if $(QUICK),--quick); forward=$$?; \
		$(BIN)/python -m benchmarks.identification $(if $(QUICK),--quick) && exit $$forward

# Stated covariances against the truth and against Markov chains (docs/explanation/verification.md): a quarter of an hour.
# Stopped, it goes on. RIGS=2 CHAINS=0 for a first look.
joint-covariance: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.joint_covariance $(if $(RIGS),--rigs $(RIGS)) $(if $(CHAINS),--chains $(CHAINS))

# The diagnosis of one drive alone on integrated drives, with noise only and with each cause (docs/explanation/axis.md), a
# quarter of an hour. N=3 for a first look, SEED=2 for others. Stopped, it goes on.
single-drives: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.single_drives $(if $(N),--n $(N)) $(if $(SEED),--seed $(SEED))

# Machines with nothing wrong in conditions that no other benchmark has, such as a night's campaign or an accuracy that is not
# what the station states (docs/explanation/disturbances.md), ten minutes. N=1 for a first look. Stopped, it goes on.
quiet-machines: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.quiet_machines $(if $(N),--n $(N)) $(if $(SEED),--seed $(SEED))

# Rows of paths that the host corrects in a second of one core.
host-rows: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks.host_rows

# Installs the extras $(1). pip would compile one file after another; compileall does on all cores. Files that are no
# Python of this version, templates and such, are passed over by either.
define install
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.$(1)'
	$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true
endef

$(VENV)/run.stamp: pyproject.toml
	$(call install)
	touch $@

$(VENV)/dev.stamp: pyproject.toml
	$(call install,[dev])
	touch $(VENV)/run.stamp $@

$(VENV)/gapbench.stamp: $(VENV)/dev.stamp
	$(call install,[gapbench])
	touch $@

$(VENV)/bench.stamp: $(VENV)/run.stamp
	$(call install,[bench])
	touch $@

clean:
	rm -rf $(VENV) runs
