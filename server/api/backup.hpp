#pragma once

namespace cellmap::server {

class Router;
struct Services;

void add_backup_route(Router& router, Services& services);

}  // namespace cellmap::server
