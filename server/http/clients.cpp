#include "server/http/clients.hpp"

#include <algorithm>
#include <utility>

namespace cellmap::server {

void Clients::add(std::unique_ptr<Client> client) {
  const std::lock_guard lock(mutex_);
  const int socket = client->connection.socket();
  watch_(*clients_.insert_or_assign(socket, std::move(client)).first->second);
}

std::size_t Clients::size() const {
  const std::lock_guard lock(mutex_);
  return clients_.size();
}

Client* Clients::take(int socket) {
  const std::lock_guard lock(mutex_);
  const auto found = clients_.find(socket);
  if (found == clients_.end() || !found->second->is_parked) return nullptr;
  found->second->is_parked = false;
  return found->second.get();
}

void Clients::park(Client& client, Phase phase) {
  const auto now = Clock::now();
  const std::lock_guard lock(mutex_);
  client.phase = phase;
  client.since = now;
  client.is_parked = true;
  watch_(client);
}

void Clients::park_again(Client& client) {
  const std::lock_guard lock(mutex_);
  client.is_parked = true;
  watch_(client);
}

void Clients::remove(Client& client) {
  const std::lock_guard lock(mutex_);
  clients_.erase(client.connection.socket());
}

std::vector<Client*> Clients::take_if(const std::function<bool(const Client&)>& condition) {
  std::vector<Client*> taken;
  const std::lock_guard lock(mutex_);
  for (const auto& [socket, client] : clients_) {
    if (!client->is_parked || !condition(*client)) continue;
    client->is_parked = false;
    taken.push_back(client.get());
  }
  return taken;
}

bool Clients::remove_longest_idle() {
  const std::lock_guard lock(mutex_);
  auto oldest = clients_.end();
  for (auto entry = clients_.begin(); entry != clients_.end(); ++entry) {
    const Client& client = *entry->second;
    if (!client.is_parked || client.phase != Phase::kIdle) continue;
    if (oldest == clients_.end() || client.since < oldest->second->since) oldest = entry;
  }
  if (oldest == clients_.end()) return false;
  clients_.erase(oldest);
  return true;
}

void Clients::remove_if(const std::function<bool(const Client&)>& condition) {
  const std::lock_guard lock(mutex_);
  std::erase_if(clients_, [&](const auto& entry) {
    return entry.second->is_parked && condition(*entry.second);
  });
}

bool Clients::is_any_answered() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::any_of(clients_, [](const auto& entry) {
    const Client& client = *entry.second;
    return !client.is_parked || client.phase == Phase::kSending || client.phase == Phase::kClosing;
  });
}

}  // namespace cellmap::server
