# Two images: `serve` has what the API needs, `worker` what workers and the sweep need. What a container does is its
# command. `docker build --build-arg PART=worker .`
FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d AS build
RUN apt-get update && apt-get install --yes --no-install-recommends make && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY requirements requirements
COPY pyproject.toml Makefile README.md LICENSE NOTICE ./
COPY apexcal apexcal
COPY service service
COPY workers workers
COPY frontend frontend
# The pages hold the documents.
COPY docs docs
# The wheel holds the built pages; node comes out of the locked development requirements.
RUN make frontend LOCKED=pages && .venv/bin/uv build --wheel --no-build-isolation --python .venv/bin/python --out-dir /wheels

FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d
ARG PART=serve
COPY requirements/bootstrap.lock requirements/${PART}.lock /tmp/requirements/
# Compiled here, for containers run on a file system that they cannot write.
RUN python -m pip install --no-cache-dir --require-hashes -r /tmp/requirements/bootstrap.lock \
 && uv pip install --system --no-cache --compile-bytecode --require-hashes -r /tmp/requirements/${PART}.lock
LABEL org.opencontainers.image.licenses="Apache-2.0" org.opencontainers.image.authors="the apexcal authors"
COPY LICENSE NOTICE /usr/share/doc/apexcal/
COPY --from=build /wheels /tmp/wheels
RUN uv pip install --system --no-cache --compile-bytecode --no-deps /tmp/wheels/*.whl \
 && rm -rf /tmp/wheels /tmp/requirements
# A volume that is first mounted on these folders takes over their owner.
RUN useradd --uid 1000 --create-home apexcal \
 && install --directory --owner apexcal --group apexcal --mode 700 /var/lib/apexcal /var/cache/apexcal /backups
USER 1000:1000
ENV APEXCAL_DATA_DIR=/var/lib/apexcal \
    NUMBA_CACHE_DIR=/var/cache/apexcal \
    OPENBLAS_NUM_THREADS=1 \
    OMP_NUM_THREADS=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1
EXPOSE 8000
CMD ["python", "-m", "uvicorn", "service.app:create_app", "--factory", "--host=0.0.0.0", "--port=8000", \
     "--http=service.platform.http.connections:PatientProtocol", "--ws=none"]
