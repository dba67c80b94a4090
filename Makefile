# make demo: set up everything and replay a simulated cut.   make test: set up everything and run the tests.
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTHON ?= python3

.PHONY: demo test test-fast check docs pages bench bench-all paper pictures recordings setup clean install-service uninstall-service

demo: $(READY)
	@$(BIN)/chatter-monitor replay replay_data/bar_turning.flac --config config/lathe.toml

# Files side by side on all cores; then, one by one, what needs a sound card or a service manager to itself.
test: $(READY)
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not system"
	$(BIN)/python -m pytest -m system

# What to run while developing: without the statistics over thousands of windows.
test-fast: $(READY)
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow and not system"

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# What each part costs next to yardsticks and how the cost grows, into docs/performance.json, and the page of it.
# Minutes on a machine that is free; other work on it makes the figures worse, and the page says how much there was.
bench: $(READY)
	nice -n 10 $(BIN)/python -m benchmarks
	$(BIN)/python -m docs.performance

# The other benchmarks: accuracy, latency, memory, archives, fleet. Hours.
bench-all: bench
	$(BIN)/python -m benchmarks.tracker_speed
	$(BIN)/python -m benchmarks.chain
	$(BIN)/python -m benchmarks.tracker_accuracy
	$(BIN)/python -m benchmarks.orders
	$(BIN)/python -m benchmarks.simulator
	$(BIN)/python -m benchmarks.identification
	$(BIN)/python -m benchmarks.discrepancy
	$(BIN)/python -m benchmarks.driven
	$(BIN)/python -m benchmarks.several
	$(BIN)/python -m benchmarks.live
	$(BIN)/python -m benchmarks.latency
	$(BIN)/python -m benchmarks.memory --hours 1
	$(BIN)/python -m benchmarks.margin
	$(BIN)/python -m benchmarks.dashboard
	$(BIN)/python -m benchmarks.archive
	$(BIN)/python -m benchmarks.fleet

# The documentation, in build/docs: a link that leads nowhere is an error, and an example that prints something else.
docs: pages
	$(BIN)/python -m pytest -q tests/test_examples.py

# The same without its examples, which take minutes.
pages: $(READY)
	$(BIN)/python -m docs.configuration
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -d build/doctrees docs build/docs
	@echo "Open build/docs/index.html"

# The figures of the paper with the numbers beside them, in docs/paper.
paper: $(READY)
	$(BIN)/python -m docs.paper

# The pictures of the dashboard, in docs/pictures: needs a graphics card, or Mesa's
# (apt-get install mesa-vulkan-drivers libvulkan1).
pictures: $(READY)
	$(BIN)/python -m docs.pictures

# The simulated recordings of replay_data, bit by bit the same.
recordings: $(READY)
	$(BIN)/python -m replay_data.make

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "chatter-monitor needs Python 3.11 or newer"; exit 2; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { apt-get update -q && apt-get install -y -q python3-venv; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) out build *.egg-info

# The service of this machine (docs/service.md), as root. Again after an update: an edited configuration stays.
# With DESTDIR only files are laid out below it, for package makers: no user, no environment, no compiling.
OPT := /opt/chatter-monitor
ETC := /etc/chatter-monitor
CACHE := /var/cache/chatter-monitor
UNITS := /etc/systemd/system
ACCOUNT := chatter-monitor

install-service:
ifndef DESTDIR
	@test "$$(id -u)" = 0 || { echo "make install-service needs root: sudo make install-service"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "chatter-monitor needs Python 3.11 or newer"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.base_prefix.startswith(("/home", "/root")))' || { echo "the service cannot see a Python in a home directory: make install-service PYTHON=/usr/bin/python3"; exit 2; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { apt-get update -q && apt-get install -y -q python3-venv; }
	@ldconfig -p | grep -q libportaudio.so.2 || { apt-get update -q && apt-get install -y -q --no-install-recommends libportaudio2; }
	getent passwd $(ACCOUNT) >/dev/null || useradd --system --user-group --home-dir /var/lib/chatter-monitor --no-create-home --shell /usr/sbin/nologin $(ACCOUNT)
	$(PYTHON) -m venv $(OPT)
	rm -rf build # what an earlier version left there would be installed again
	$(OPT)/bin/python -m pip install -q --disable-pip-version-check -c constraints.txt .
	install -d -o root -g $(ACCOUNT) -m 0750 $(ETC) $(ETC)/keys $(ETC)/keys/allowed
	install -d -o $(ACCOUNT) -g $(ACCOUNT) -m 0750 $(CACHE)
endif
	install -D -m 0644 config/chatter-monitor.service $(DESTDIR)$(UNITS)/chatter-monitor.service
	install -D -m 0644 docs/service.md $(DESTDIR)$(OPT)/share/doc/service.md
	install -D -m 0644 config/machine.toml $(DESTDIR)$(ETC)/machine.toml.example
	test -e $(DESTDIR)$(ETC)/machine.toml || install -m 0644 config/machine.toml $(DESTDIR)$(ETC)/machine.toml
ifndef DESTDIR
	ln -sf $(OPT)/bin/chatter-monitor /usr/local/bin/chatter-monitor
	@echo "Compiling the kernels and trying them on a simulated cut; this takes about a minute."
	rm -rf $(CACHE)/kernels-* # those of earlier versions
	NUMBA_CACHE_DIR=$(CACHE) $(OPT)/bin/chatter-monitor replay replay_data/bar_turning.flac
	chown -R $(ACCOUNT):$(ACCOUNT) $(CACHE)
	@if [ -d /run/systemd/system ]; then systemctl daemon-reload && systemctl try-restart chatter-monitor; fi
	@echo
	@echo "Installed. What next:"
	@echo "  chatter-monitor devices                    which sound devices there are"
	@echo "  editor $(ETC)/machine.toml    say which one, and what the machine is called"
	@echo "  systemctl enable --now chatter-monitor     start it, now and with the machine"
	@echo "  systemctl status chatter-monitor           how it goes; docs/service.md tells the rest"
endif

uninstall-service:
	-systemctl disable --now chatter-monitor
	rm -rf $(OPT) $(CACHE) $(UNITS)/chatter-monitor.service /usr/local/bin/chatter-monitor
	-systemctl daemon-reload
	@echo "Removed, but for what is yours: $(ETC), /var/lib/chatter-monitor and the user $(ACCOUNT)."
