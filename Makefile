# The two commands of the README are `make demo` and `make test`.  Each sets everything up first, once.

RUN   := .venv/bin/python
AREAS := formats plugins converters renderer reference
DEMO  := .venv/.demo
READY := .venv/.ready

# Tests run in six sets, one after another, each in processes of its own: what solvers' libraries, kernels and the tests
# themselves take in memory leaves with them, and no process grows beyond 1.5 GB.
DRAWING    := tests/renderer tests/trials tests/viewer
CONVERTING := tests/converters
REFERENCE  := tests/examples tests/reference
EXTENDING  := tests/benchmarks tests/plugins
HOUSE      := tests/house
OTHERS     := $(filter-out $(DRAWING) $(CONVERTING) $(REFERENCE) $(EXTENDING) $(HOUSE) tests/__pycache__,$(patsubst %/,%,$(wildcard tests/*/)))

# run_tests OPTIONS: every set, also after one that failed; tests that draw also wait, for browsers and other processes
define run_tests
@failed=; processors=$$(getconf _NPROCESSORS_ONLN); \
for set in "$(DRAWING)" "$(CONVERTING)" "$(REFERENCE)" "$(EXTENDING)" "$(HOUSE)" "$(OTHERS)"; do \
	test "$$set" = "$(DRAWING)" && count=$$((processors + 1)) || count=$$processors; \
	$(RUN) -m pytest --numprocesses $$count --maxprocesses 4 --dist worksteal $(1) $$set || failed="$$failed $$set"; \
done; test -z "$$failed" || { echo "not all tests passed in:$$failed"; exit 1; }
endef

.PHONY: help demo test check lint pages every-test docs bench exactness fuzz mutants setup clean

help:
	@echo "make demo    set up, then draw the sample data; the pictures land in out/"
	@echo "make test    set up, then lint, check the types and run every test"
	@echo "make check   lint and the quick tests, two minutes: before each commit"
	@echo "make lint    ruff, mypy and the syntax of JavaScript"
	@echo "make pages   docs/scene.md, scene.schema.json, types of keywords, quantities.md, gallery.md, elvis.1, what notebooks show, from what they are about"
	@echo "make every-test  thorough tests, and all cases of families of which make test runs samples (SAMPLE_SEED=2: others)"
	@echo "make docs    the site, in out/site: pages, reference of commands and Python, gallery, notebooks"
	@echo "make bench   the benchmarks, a printed table"
	@echo "make exactness   certain pixels against analytic expressions, ten million of them: hours"
	@echo "make fuzz        a hundred thousand damaged files through every reader, 4,300 broken runs, huge inputs: two hours"
	@echo "make mutants     60 small changes of the code, and which of them the tests find: an hour (SEED=2: others)"
	@echo "make setup   set up again, also the system packages"
	@echo "make clean   remove everything that these commands made"

demo: $(DEMO)
	@$(RUN) examples/demo.py

# programs come from the network while the code is checked
test: $(READY)
	@sh tools/programs.sh & $(MAKE) --no-print-directory lint; checked=$$?; wait; exit $$checked
	$(call run_tests)

check: lint
	$(call run_tests,-m "not long")

lint: $(READY)
	@$(RUN) -m ruff check
	@$(RUN) -m ruff format --check
	@$(RUN) tools/sizes.py
	@$(RUN) tools/javascript.py
	@if $(RUN) -c 'import sys; sys.exit(sys.version_info < (3, 12))'; then $(RUN) -m mypy --num-workers auto $(AREAS); \
	else echo "types are not checked: the NumPy of Python 3.10 and 3.11 is annotated too coarsely"; fi

pages: $(READY)
	@$(RUN) tools/scene_page.py
	@$(RUN) tools/keyword_types.py
	@$(RUN) tools/manual.py
	@$(RUN) tools/quantities_page.py
	@$(RUN) tools/formats_page.py
	@$(RUN) tools/gallery_page.py
	@$(RUN) examples/generate.py out/data
	@$(RUN) tools/notebooks.py out/data

every-test: export EVERY_TEST = 1
every-test: $(READY)
	@sh tools/programs.sh
	$(call run_tests,-m "sampled or thorough")

docs: $(READY)
	@$(RUN) -m pip install --quiet --editable '.[docs]'
	@$(RUN) -m sphinx --fail-on-warning --keep-going --quiet -c docs -d out/site-cache . out/site
	@echo "The site is in out/site; open out/site/index.html."

bench: $(READY)
	@$(RUN) benchmarks/run.py

exactness: $(READY)
	@$(RUN) benchmarks/exactness.py
	@$(RUN) benchmarks/stated_errors.py

fuzz: $(READY)
	@$(RUN) tests/fuzz/run.py
	@$(RUN) tests/fuzz/interruptions.py
	@$(RUN) tests/fuzz/neighbours.py
	@$(RUN) tests/fuzz/pages.py
	@$(RUN) tests/fuzz/large.py

mutants: $(READY)
	@$(RUN) tests/mutation/mutants.py --jobs 2 $(if $(SEED),--seed $(SEED))

setup:
	@rm -f $(DEMO) $(READY)
	@$(MAKE) --no-print-directory $(READY)

clean:
	rm -rf .venv out dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is newer than what it depends on once everything is installed; then nothing is done again.  The demonstration needs
# a third of what the tests need, which compare with every solver's library.
$(DEMO): pyproject.toml tools/setup.sh tools/vulkan.sh
	@sh tools/setup.sh demo
	@touch $@

$(READY): pyproject.toml tools/setup.sh tools/vulkan.sh
	@sh tools/setup.sh test
	@touch $(DEMO) $@
