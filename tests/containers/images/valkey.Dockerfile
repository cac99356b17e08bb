# For valkey/valkey:9.1: its user 999 and paths. Differs: the server of a wheel; redis-cli is its valkey-cli; no entry
# point, which changes nothing where the container does not start as root.
FROM apexcal-local/base
RUN groupadd --system --gid 999 valkey \
 && useradd --system --gid valkey --uid 999 valkey \
 && install --directory --owner valkey --group valkey --mode 1777 /data /run/valkey \
 && ln -s /usr/bin/redis-cli /usr/local/bin/valkey-cli
COPY valkey-server /usr/local/bin/valkey-server
RUN chmod +x /usr/local/bin/valkey-server
WORKDIR /data
CMD ["valkey-server"]
