# For caddy:2.10.2: its user (root), paths, modes and the capability on its binary. Differs: Debian, not Alpine.
FROM apexcal-local/base
COPY caddy /usr/bin/caddy
RUN mkdir -p /config/caddy /data/caddy /etc/caddy /usr/share/caddy \
 && setcap cap_net_bind_service=+ep /usr/bin/caddy \
 && chmod +x /usr/bin/caddy \
 && chmod -R g=u /config /data /etc/caddy /usr/share/caddy /usr/bin/caddy
ENV XDG_CONFIG_HOME=/config \
    XDG_DATA_HOME=/data
WORKDIR /srv
CMD ["caddy", "run", "--config", "/etc/caddy/Caddyfile", "--adapter", "caddyfile"]
