# For chrislusf/seaweedfs:4.48: its user 1000 and paths, the same binary. Differs: Debian, not Alpine; no entry point,
# which the compose file replaces.
FROM apexcal-local/base
RUN groupadd --gid 1000 seaweed \
 && useradd --gid seaweed --uid 1000 seaweed \
 && install --directory --owner seaweed --group seaweed /data /etc/seaweedfs
COPY weed /usr/bin/weed
RUN chmod +x /usr/bin/weed
VOLUME /data
WORKDIR /data
