# SPDX-License-Identifier: Apache-2.0
# Physics: PyBullet, and all that reads the files of scenarios and worlds.

FROM python:3.11-slim-bookworm AS requirements
COPY pyproject.toml .
RUN python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
print(*p["dependencies"] + p["optional-dependencies"]["physics"], sep="\n")' > /requirements.txt

# Shared by all images, so built only once.
FROM python:3.11-slim-bookworm AS wheels
RUN apt-get update -q \
 && apt-get install -y -q --no-install-recommends gcc libc6-dev \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN --mount=type=cache,target=/root/.cache/pip \
    pip wheel -q --no-deps -w /wheels . ./udp-bridge

FROM python:3.11-slim-bookworm AS build
RUN apt-get update -q \
 && apt-get install -y -q --no-install-recommends binutils \
 && rm -rf /var/lib/apt/lists/*
RUN python -m venv --without-pip /opt/groundlink
COPY --from=requirements /requirements.txt /
# Of PyBullet's wheel, nothing here uses 142 MB of models and 131 MB of debug symbols.
RUN --mount=type=cache,target=/root/.cache/pip \
    pip --python /opt/groundlink/bin/python install -q -r /requirements.txt \
 && cd /opt/groundlink/lib/python3.11/site-packages \
 && rm -r pybullet_data \
 && strip --strip-unneeded pybullet.*.so
RUN --mount=from=wheels,source=/wheels,target=/wheels \
    pip --python /opt/groundlink/bin/python install -q --no-deps /wheels/groundlink-*.whl \
 && find /opt/groundlink -name tests -type d -prune -exec rm -r {} +

FROM python:3.11-slim-bookworm
COPY --from=build /opt/groundlink /opt/groundlink
ENV PATH=/opt/groundlink/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
USER 65532:65532
ENTRYPOINT ["python", "-m", "services.physics"]
CMD ["indoor_lab"]
