# SPDX-License-Identifier: Apache-2.0
# Searches, campaigns and their workers: all that a recorded run without cameras needs.

FROM python:3.11-slim-bookworm AS requirements
COPY pyproject.toml .
RUN python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
more = [each for name in ("physics", "sensors", "search") for each in p["optional-dependencies"][name]]; \
print(*p["dependencies"] + more, sep="\n")' > /requirements.txt

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
RUN python -m venv --without-pip /opt/groundlink
COPY --from=requirements /requirements.txt /
RUN --mount=type=cache,target=/root/.cache/pip \
    pip --python /opt/groundlink/bin/python install -q -r /requirements.txt
RUN --mount=from=wheels,source=/wheels,target=/wheels \
    pip --python /opt/groundlink/bin/python install -q --no-deps /wheels/*.whl \
 && find /opt/groundlink -name tests -type d -prune -exec rm -r {} +

FROM python:3.11-slim-bookworm
COPY --from=build /opt/groundlink /opt/groundlink
ENV PATH=/opt/groundlink/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
USER 65532:65532
ENTRYPOINT ["python", "-m", "groundlink"]
