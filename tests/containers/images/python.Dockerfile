# For python:3.11-slim-bookworm. Differs: Debian's own Python 3.11 in /usr/bin, not one built into /usr/local.
FROM apexcal-local/base
RUN apt-get update \
 && apt-get install --yes --no-install-recommends python3 python3-pip python3-venv \
 && rm -rf /var/lib/apt/lists/* /usr/lib/python3*/EXTERNALLY-MANAGED \
 && ln -s python3 /usr/bin/python
CMD ["python3"]
