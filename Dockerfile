# The monitor in a container. docs/service.md tells how to give it a sound card.
#   docker build -t chatter-monitor .

FROM debian:bookworm-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3 python3-venv
WORKDIR /src
COPY pyproject.toml constraints.txt README.md ./
COPY chatter_monitor chatter_monitor
RUN python3 -m venv /opt/chatter-monitor \
    && /opt/chatter-monitor/bin/python -m pip install --no-cache-dir -c constraints.txt . \
    && /opt/chatter-monitor/bin/python -m pip uninstall --yes setuptools pip

FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3 libportaudio2 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --user-group --groups audio --home-dir /var/lib/chatter-monitor --shell /usr/sbin/nologin chatter-monitor \
    && install -d -o chatter-monitor -g chatter-monitor -m 0750 /var/lib/chatter-monitor /var/cache/chatter-monitor
COPY --from=build /opt/chatter-monitor /opt/chatter-monitor
COPY config/machine.toml /etc/chatter-monitor/machine.toml
ENV PATH=/opt/chatter-monitor/bin:$PATH NUMBA_CACHE_DIR=/var/cache/chatter-monitor PYTHONUNBUFFERED=1
USER chatter-monitor
WORKDIR /var/lib/chatter-monitor
# Machine code for the processor that the image is built on; on another kind it is compiled again at the first start.
COPY replay_data/bar_turning.flac /tmp/
RUN chatter-monitor replay /tmp/bar_turning.flac
VOLUME /var/lib/chatter-monitor
# Not whether the process lives, but whether it hears.
HEALTHCHECK --interval=30s --timeout=20s --start-period=120s \
    CMD ["chatter-monitor", "doctor", "--running", "--config", "/etc/chatter-monitor/machine.toml"]
ENTRYPOINT ["chatter-monitor"]
CMD ["run", "--config", "/etc/chatter-monitor/machine.toml"]
