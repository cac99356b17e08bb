# What the stand-ins below have in common; `engine.py` imports the root file system that it begins with.
FROM apexcal-local/bookworm
RUN apt-get update \
 && apt-get install --yes --no-install-recommends busybox-static ca-certificates libcap2-bin redis-tools \
 && ln -s /bin/busybox /usr/local/bin/wget \
 && rm -rf /var/lib/apt/lists/*
COPY certificates.crt /etc/ssl/certs/ca-certificates.crt
# Package clients of a build trust what this machine trusts.
ENV SSL_CERT_FILE=/etc/ssl/certs/ca-certificates.crt \
    PIP_CERT=/etc/ssl/certs/ca-certificates.crt \
    NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt
