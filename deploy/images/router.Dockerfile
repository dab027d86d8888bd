# SPDX-License-Identifier: Apache-2.0
# The router, and what needs no library of its own beside the bus: drivers of vehicles.

FROM python:3.11-slim-bookworm AS requirements
COPY pyproject.toml .
RUN python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
print(*p["dependencies"], sep="\n")' > /requirements.txt

FROM python:3.11-slim-bookworm AS build
RUN apt-get update -q \
 && apt-get install -y -q --no-install-recommends gcc libc6-dev \
 && rm -rf /var/lib/apt/lists/*
RUN python -m venv --without-pip /opt/groundlink
WORKDIR /source
COPY --from=requirements /requirements.txt .
RUN --mount=type=cache,target=/root/.cache/pip \
    pip --python /opt/groundlink/bin/python install -q -r requirements.txt
COPY . .
RUN pip --python /opt/groundlink/bin/python install -q --no-deps . \
 && find /opt/groundlink -name tests -type d -prune -exec rm -r {} +

FROM python:3.11-slim-bookworm
COPY --from=build /opt/groundlink /opt/groundlink
ENV PATH=/opt/groundlink/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
USER 65532:65532
ENTRYPOINT ["python", "-m"]
CMD ["services.router", "--listen", "tcp/0.0.0.0:7447"]
